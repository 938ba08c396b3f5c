#include "engine/volume/grid.h"

#include <algorithm>

namespace fovea {

void RepeatBorder(const Box3& inside, Grid* grid) {
  const Box3& box = grid->box;
  if (inside.Contains(box)) {
    return;
  }
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      float* const row = grid->Row(y, z) - box.lo.x;  // of x = 0
      const float* const from = grid->Row(std::clamp(y, inside.lo.y, inside.hi.y - 1),
                                          std::clamp(z, inside.lo.z, inside.hi.z - 1)) -
                                box.lo.x;
      if (from != row) {
        std::copy(from + inside.lo.x, from + inside.hi.x, row + inside.lo.x);
      }
      std::fill(row + box.lo.x, row + inside.lo.x, row[inside.lo.x]);
      std::fill(row + inside.hi.x, row + box.hi.x, row[inside.hi.x - 1]);
    }
  }
}

}  // namespace fovea
