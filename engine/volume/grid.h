#ifndef ENGINE_VOLUME_GRID_H_
#define ENGINE_VOLUME_GRID_H_

#include <cstddef>
#include <vector>

#include "engine/volume/geometry.h"

namespace fovea {

/// A dense box of float values, x fastest, then y, then z. `box` is in the coordinates of some
/// level and may reach outside the volume (an apron).
struct Grid {
  Box3 box;
  std::vector<float> values;  // box.Volume() of them

  Grid() = default;
  explicit Grid(const Box3& where, float fill = 0.0F)
      : box(where), values(static_cast<size_t>(where.Volume()), fill) {}

  [[nodiscard]] size_t Index(int64_t x, int64_t y, int64_t z) const {
    const Int3 size = box.Size();
    return static_cast<size_t>(((z - box.lo.z) * size.y + (y - box.lo.y)) * size.x + x - box.lo.x);
  }
  /// The value at (x, y, z), which must lie in `box`.
  [[nodiscard]] float At(int64_t x, int64_t y, int64_t z) const { return values[Index(x, y, z)]; }
  float& At(int64_t x, int64_t y, int64_t z) { return values[Index(x, y, z)]; }
  /// The row (.., y, z), starting at x = box.lo.x.
  [[nodiscard]] const float* Row(int64_t y, int64_t z) const {
    return values.data() + Index(box.lo.x, y, z);
  }
  float* Row(int64_t y, int64_t z) { return values.data() + Index(box.lo.x, y, z); }
};

/// Every position of grid->box outside `inside` (not empty, within it) becomes a copy of the
/// nearest position in `inside`.
void RepeatBorder(const Box3& inside, Grid* grid);

}  // namespace fovea

#endif  // ENGINE_VOLUME_GRID_H_
