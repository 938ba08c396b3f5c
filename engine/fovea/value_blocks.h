#ifndef ENGINE_FOVEA_VALUE_BLOCKS_H_
#define ENGINE_FOVEA_VALUE_BLOCKS_H_

#include <vector>

#include "engine/volume/grid.h"

namespace fovea {

/// The smallest and largest value of every cube of kEdge points of a grid, each cube grown by one
/// point on its far sides: whatever a sample interpolates between the points p and p + 1 on every
/// axis lies within the bounds of the block of p. Renderers skip blocks by them.
struct ValueBlocks {
  static constexpr int64_t kEdge = 8;
  Int3 count;                    // blocks on each axis, from the grid's lower corner
  std::vector<float> low, high;  // x fastest, then y, then z; low > high where all values are NaN

  [[nodiscard]] size_t Index(int64_t x, int64_t y, int64_t z) const {
    return static_cast<size_t>((z * count.y + y) * count.x + x);
  }
};

[[nodiscard]] ValueBlocks MakeValueBlocks(const Grid& grid, int threads);

}  // namespace fovea

#endif  // ENGINE_FOVEA_VALUE_BLOCKS_H_
