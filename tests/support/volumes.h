#ifndef TESTS_SUPPORT_VOLUMES_H_
#define TESTS_SUPPORT_VOLUMES_H_

#include <cmath>
#include <cstdint>
#include <functional>

#include "engine/volume/brick_grid.h"
#include "engine/volume/grid.h"
#include "engine/volume/hierarchy.h"
#include "engine/wavelet/haar.h"

/// Analytic volumes: truth without a file.
namespace fovea::testing {

/// A dense grid of `value(x, y, z)` at the voxels' centres.
inline Grid MakeGrid(const Int3& dims, const std::function<double(double, double, double)>& value) {
  Grid grid(Box3::OfSize(dims));
  for (int64_t z = 0; z < dims.z; ++z) {
    for (int64_t y = 0; y < dims.y; ++y) {
      for (int64_t x = 0; x < dims.x; ++x) {
        grid.At(x, y, z) =
            static_cast<float>(value(static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5,
                                     static_cast<double>(z) + 0.5));
      }
    }
  }
  return grid;
}

/// Waves of several lengths with a sharp ball in the middle; values 0 to 1.
inline Grid MakeWavyGrid(const Int3& dims) {
  const Vec3 middle{0.5 * static_cast<double>(dims.x), 0.5 * static_cast<double>(dims.y),
                    0.5 * static_cast<double>(dims.z)};
  const double radius = 0.3 * static_cast<double>(dims.Max());
  return MakeGrid(dims, [=](double x, double y, double z) {
    const double wave = 0.25 + 0.08 * std::sin(0.9 * x + 0.3 * z) + 0.08 * std::sin(0.23 * y) +
                        0.08 * std::cos(0.51 * z - 0.2 * x * y / 40);
    const bool inside = Length(Vec3{x, y, z} - middle) < radius;
    return inside ? wave + 0.5 : wave;
  });
}

inline CoefficientSet MakeCoefficients(const Grid& grid, int64_t edge = 16) {
  BrickGrid bricks(grid.box.Size(), edge, 1, 0.0F);
  bricks.CopyIn(grid.box, grid.values);
  return wavelet::ForwardHaar(bricks, Hierarchy::Make(grid.box.Size()).value(), 0);
}

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_VOLUMES_H_
