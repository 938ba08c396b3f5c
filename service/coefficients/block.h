#ifndef SERVICE_COEFFICIENTS_BLOCK_H_
#define SERVICE_COEFFICIENTS_BLOCK_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/stored_type.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"
#include "service/coefficients/plan.h"

/// The bytes of one block (docs/formats/coefficient-stream.md). Thread-safe.
namespace fovea::coefficients {

struct BlockBox {
  int level = kCoarse;
  Box3 box;
  bool difference = false;
  float scale = 1;
  /// Numbers in it: seven a place, or one of kCoarse.
  [[nodiscard]] int64_t Values() const;
  friend bool operator==(const BlockBox&, const BlockBox&) = default;
};

/// What a block says about its numbers.
struct BlockHeader {
  std::string type = "float32";  // of all numbers: float32, int16 or int32
  int field = 0;
  uint64_t step = 0, base_step = 0;
  std::vector<BlockBox> boxes;
  [[nodiscard]] int64_t Values() const;
  [[nodiscard]] bool HasDifferences() const;
  friend bool operator==(const BlockHeader&, const BlockHeader&) = default;
};

/// The block of `numbers`, those of all boxes in order as ToStored (stored_type.h) makes them.
/// `base` holds as many; only those of boxes with a difference are looked at, so without any it may
/// be empty. What exceeds the limits of plan.h is INTERNAL.
[[nodiscard]] StatusOr<std::string> EncodeBlock(const BlockHeader& header,
                                                const Hierarchy& hierarchy,
                                                std::span<const std::byte> numbers,
                                                std::span<const std::byte> base);

/// A block that came: its header is checked, its numbers still compressed.
struct ReceivedBlock {
  BlockHeader header;
  uint32_t numbers_crc = 0;
  std::string_view stream;  // part of what was parsed
};

/// DATA_LOSS, saying what, unless `bytes` are a block of coefficients of `hierarchy`. Takes a few
/// MiB at most, here and in DecodeNumbers.
[[nodiscard]] StatusOr<ReceivedBlock> ParseBlock(std::string_view bytes,
                                                 const Hierarchy& hierarchy);

/// The numbers of a block, header.Values() of them; `base` as in EncodeBlock. DATA_LOSS if they are
/// damaged, or not finite or not in their range; FAILED_PRECONDITION if they are differences that
/// do not fit `base`.
[[nodiscard]] StatusOr<std::vector<std::byte>> DecodeNumbers(const ReceivedBlock& block,
                                                             std::span<const std::byte> base);

}  // namespace fovea::coefficients

#endif  // SERVICE_COEFFICIENTS_BLOCK_H_
