// Names of files: sequences, patterns, numbers in them.

#include "ingest/ingest.h"
#include "ingest/name_pattern.h"
#include "service/export/naming.h"
#include "tests/fuzz/input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fovea;
  fuzz::Input input(data, size);
  const auto from = input.Number<int64_t>();
  const auto to = input.Number<int64_t>();
  const std::string name = input.Until('\n');
  const std::string other = input.Until('\n');
  if (const auto pattern = ingest::NamePattern::Parse(name); pattern.ok() && pattern->has_value()) {
    (void)(*pattern)->Match(other);
    (void)(*pattern)->Describe();
  }
  (void)ingest::NumbersThatDiffer({name, other});
  (void)ingest::WithNumber(name, from, to);
  fuzz::Require(!(ingest::NaturalLess(name, other) && ingest::NaturalLess(other, name)));
  fuzz::Require(!ingest::NaturalLess(name, name));
  if (const auto pattern = exports::FramePattern::Parse(name); pattern.ok()) {
    (void)pattern->PathOf(to < 0 ? 0 : to);
    (void)pattern->Stem();
  }
  (void)ingest::ParseRawFormat(name).ok();
  return 0;
}
