// Chunks of Blosc. Any bytes are refused or give values, and values come back as they went in. What
// a header says of sizes is put right on demand, because few guesses pass.

#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "engine/store/blosc.h"
#include "tests/fuzz/input.h"

namespace {

using namespace fovea::store;

/// The checks of lengths come first; behind them are the streams.
void MendSizes(uint8_t type_bytes, size_t value_bytes, std::string* chunk) {
  if (chunk->size() < kBloscHeaderBytes) {
    return;
  }
  const auto bytes = static_cast<uint32_t>(value_bytes);
  const auto chunk_bytes = static_cast<uint32_t>(chunk->size());
  (*chunk)[0] = 2;  // version of the format
  (*chunk)[3] = static_cast<char>(type_bytes);
  std::memcpy(chunk->data() + 4, &bytes, sizeof(bytes));
  std::memcpy(chunk->data() + 8, &bytes, sizeof(bytes));  // of the block
  std::memcpy(chunk->data() + 12, &chunk_bytes, sizeof(chunk_bytes));
}

void RoundTrip(std::span<const std::byte> values, int type_bytes) {
  BloscEncoder encoder;
  BloscDecoder decoder;
  const auto chunk = encoder.Encode(values, type_bytes, ValueKind::kWhole);
  if (values.empty()) {
    fovea::fuzz::Require(!chunk.ok());
    return;
  }
  fovea::fuzz::Require(chunk.ok() && chunk->size() <= values.size() + kBloscHeaderBytes);
  std::vector<std::byte> back(values.size());
  fovea::fuzz::Require(decoder.Decode(*chunk, type_bytes, back).ok());
  fovea::fuzz::Require(std::equal(back.begin(), back.end(), values.begin()));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fovea::fuzz::Input input(data, size);
  const auto how = input.Number<uint8_t>();
  const auto type_bytes = static_cast<uint8_t>(1U << (how % 3));
  const auto count = static_cast<size_t>(input.Number<uint16_t>() % 2048);
  std::string chunk = input.Rest();
  if (how & 0x40U) {  // the bytes are values
    const size_t whole = chunk.size() / type_bytes * type_bytes;
    RoundTrip(std::as_bytes(std::span(chunk)).first(whole), type_bytes);
    return 0;
  }
  std::vector<std::byte> values(count * type_bytes);
  if (how & 0x80U) {
    MendSizes(type_bytes, values.size(), &chunk);
  }
  BloscDecoder decoder;
  if (decoder.Decode(std::as_bytes(std::span(chunk)), type_bytes, values).ok()) {
    RoundTrip(values, type_bytes);
  }
  return 0;
}
