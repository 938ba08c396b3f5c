// Files of sensor readings, whole and in pieces: both ways give the same.

#include "ingest/sensors/reading_parser.h"
#include "tests/fuzz/input.h"

namespace {

using namespace fovea;
using namespace fovea::ingest;

struct Outcome {
  bool ok = true;
  size_t readings = 0;
  size_t values = 0;
  int64_t bad = 0;
  friend bool operator==(const Outcome&, const Outcome&) = default;
};

/// Gives the parser `piece` more bytes at a time, with what it left in front.
Outcome Parse(const std::string& bytes, size_t piece, ReadingFormat format, bool keyed) {
  StepKeys keys;
  BadLines bad;
  bad.most = 5;
  ParserOptions options;
  options.format = format;
  options.columns.step = keyed ? "k" : "";
  options.keys = &keys;
  options.bad = &bad;
  const auto parser = MakeReadingParser(options, "file");
  ReadingBlock block;
  std::string pending;
  Outcome outcome;
  for (size_t begin = 0; outcome.ok; begin += piece) {
    const bool last = begin + piece >= bytes.size();
    pending += bytes.substr(std::min(begin, bytes.size()), piece);
    const auto taken = parser->Parse(pending, last, &block);
    outcome.ok = taken.ok();
    if (taken.ok()) {
      fuzz::Require(*taken <= pending.size());
      pending.erase(0, *taken);
    }
    if (last) {
      break;
    }
  }
  fuzz::Require(block.values.size() % (block.readings.empty() ? 1 : block.readings.size()) == 0);
  outcome.readings = block.readings.size();
  outcome.values = block.values.size();
  outcome.bad = bad.count;
  return outcome;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const auto choice = input.Number<uint8_t>();
  const auto format = static_cast<ReadingFormat>(choice % 3);
  const bool keyed = choice % 8 >= 4;
  const std::string bytes = input.Rest();
  const Outcome whole = Parse(bytes, bytes.size() + 1, format, keyed);
  const Outcome pieces = Parse(bytes, 7, format, keyed);
  fuzz::Require(whole.ok == pieces.ok);
  fuzz::Require(!whole.ok || whole == pieces);
  return 0;
}
