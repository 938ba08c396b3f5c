#ifndef ENGINE_SENSORS_MORTON_H_
#define ENGINE_SENSORS_MORTON_H_

#include <cstdint>

#include "engine/volume/geometry.h"

/// Positions as one number whose bits are those of x, y and z in turn (Morton's order), x lowest.
/// What lies in one super-voxel is then one run of numbers: `key >> 3` is the key of the parent,
/// and sorting the voxels sorts every level.
namespace fovea::sensors {

/// Bit i of `part`, which must be less than 2^16, at bit 3i.
[[nodiscard]] constexpr uint64_t SpreadBits(uint64_t part) {
  part = (part | (part << 16)) & 0xff0000ffULL;
  part = (part | (part << 8)) & 0xf00f00f00fULL;
  part = (part | (part << 4)) & 0xc30c30c30c3ULL;
  return (part | (part << 2)) & 0x249249249249ULL;
}

/// The reverse: bits 0, 3, 6 ... of `key` side by side.
[[nodiscard]] constexpr uint64_t GatherBits(uint64_t key) {
  key &= 0x249249249249ULL;
  key = (key | (key >> 2)) & 0xc30c30c30c3ULL;
  key = (key | (key >> 4)) & 0xf00f00f00fULL;
  key = (key | (key >> 8)) & 0xff0000ffULL;
  return (key | (key >> 16)) & 0xffffULL;
}

/// Of a position whose axes are 0 to 65535.
[[nodiscard]] constexpr uint64_t MortonKey(const Int3& at) {
  return SpreadBits(static_cast<uint64_t>(at.x)) | SpreadBits(static_cast<uint64_t>(at.y)) << 1 |
         SpreadBits(static_cast<uint64_t>(at.z)) << 2;
}

[[nodiscard]] constexpr Int3 MortonPosition(uint64_t key) {
  return {static_cast<int64_t>(GatherBits(key)), static_cast<int64_t>(GatherBits(key >> 1)),
          static_cast<int64_t>(GatherBits(key >> 2))};
}

}  // namespace fovea::sensors

#endif  // ENGINE_SENSORS_MORTON_H_
