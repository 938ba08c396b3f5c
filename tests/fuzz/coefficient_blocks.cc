// What a server may send as blocks of coefficients, down the road of a client: parsed, decoded with
// and without a base, and added to what is held.

#include <cstring>
#include <string>
#include <vector>

#include "engine/store/stored_type.h"
#include "service/coefficients/block.h"
#include "service/coefficients/held_step.h"
#include "service/frames/deflate.h"
#include "tests/fuzz/input.h"

namespace {

using namespace fovea;
using namespace fovea::coefficients;

void Take(const std::string& bytes) {
  const Hierarchy hierarchy = Hierarchy::Make({70, 61, 53}).value();
  const auto block = ParseBlock(bytes, hierarchy);
  const std::vector<HeldStep::Field> fields = {{"a", {}, 1}, {"b", {}, 2}};
  HeldStep base(hierarchy, 1, fields);
  HeldStep held(hierarchy, 2, fields);
  const auto added = held.Add(bytes, &base);
  if (!block.ok()) {
    fuzz::Require(!added.ok());
    return;
  }
  const BlockHeader& header = block->header;
  const std::vector<std::byte> zeros(
      static_cast<size_t>(header.Values() * store::BytesOfType(header.type)));
  const auto numbers = DecodeNumbers(*block, zeros);
  fuzz::Require(!added.ok() || *added == header.Values());
  if (numbers.ok()) {  // what was read can be written, and is then the same again
    const auto again = EncodeBlock(header, hierarchy, *numbers, zeros);
    fuzz::Require(again.ok());
    const auto twice = ParseBlock(*again, hierarchy);
    fuzz::Require(twice.ok() && twice->header == header);
    const auto same = DecodeNumbers(*twice, zeros);
    fuzz::Require(same.ok() && *same == *numbers);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  Take(bytes);
  if (bytes.size() >= 4) {  // behind the checksum, too
    const uint32_t crc = frames::Crc32(std::string_view(bytes).substr(0, bytes.size() - 4));
    std::memcpy(bytes.data() + bytes.size() - 4, &crc, 4);
    Take(bytes);
  }
  return 0;
}
