#include "engine/sensors/density.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/sensors/morton.h"
#include "engine/volume/grid.h"

namespace fovea::sensors {
namespace {

/// The readings in each cell of the coarsest level.
Grid CountByCell(const Hierarchy& hierarchy, const MeasuredVoxels& voxels) {
  Grid counts(Box3::OfSize(hierarchy.DimsAt(0)));
  for (size_t i = 0; i < voxels.keys.size(); ++i) {
    const Int3 at = MortonPosition(voxels.keys[i] >> (3 * hierarchy.finest()));
    counts.At(at.x, at.y, at.z) += static_cast<float>(voxels.readings[i]);
  }
  return counts;
}

/// The cell and its neighbours that hold most readings together.
Box3 Fullest(const Grid& counts) {
  Box3 best;
  double most = -1;
  const Int3 size = counts.box.Size();
  for (int64_t i = 0; i < size.Product(); ++i) {
    const Int3 at{i % size.x, i / size.x % size.y, i / size.x / size.y};
    const Box3 around = Intersect(counts.box, Box3{at, {at.x + 1, at.y + 1, at.z + 1}}.Grown(1));
    double sum = counts.At(at.x, at.y, at.z);  // counts twice, so that it is in the middle
    for (int64_t z = around.lo.z; z < around.hi.z; ++z) {
      for (int64_t y = around.lo.y; y < around.hi.y; ++y) {
        for (int64_t x = around.lo.x; x < around.hi.x; ++x) {
          sum += counts.At(x, y, z);
        }
      }
    }
    if (sum > most) {
      most = sum;
      best = around;
    }
  }
  return best;
}

/// The middle of voxel `key`.
Vec3 Middle(uint64_t key) {
  const Int3 at = MortonPosition(key);
  return {static_cast<double>(at.x) + 0.5, static_cast<double>(at.y) + 0.5,
          static_cast<double>(at.z) + 0.5};
}

/// The half-width of the cube around `fovea` that holds 90 % of the readings.
double Reach(const MeasuredVoxels& voxels, const Vec3& fovea, int64_t longest) {
  std::vector<double> by_distance(static_cast<size_t>(longest) + 2);
  double all = 0;
  for (size_t i = 0; i < voxels.keys.size(); ++i) {
    const Vec3 away = Middle(voxels.keys[i]) - fovea;
    const double distance = std::max({std::abs(away.x), std::abs(away.y), std::abs(away.z)}) + 0.5;
    by_distance[std::min(static_cast<size_t>(std::ceil(distance)), by_distance.size() - 1)] +=
        voxels.readings[i];
    all += voxels.readings[i];
  }
  double sum = 0;
  for (size_t distance = 0; distance < by_distance.size(); ++distance) {
    sum += by_distance[distance];
    if (sum >= 0.9 * all) {
      return static_cast<double>(distance);
    }
  }
  return static_cast<double>(longest);
}

}  // namespace

Density MeasureDensity(const Hierarchy& hierarchy, const MeasuredVoxels& voxels) {
  const Box3 box = Fullest(CountByCell(hierarchy, voxels));
  Density density;
  double weight = 0;
  for (size_t i = 0; i < voxels.keys.size(); ++i) {
    if (box.Contains(MortonPosition(voxels.keys[i] >> (3 * hierarchy.finest())))) {
      const double readings = voxels.readings[i];
      density.fovea = density.fovea + readings * Middle(voxels.keys[i]);
      weight += readings;
    }
  }
  density.fovea = (1 / weight) * density.fovea;
  // A window of r coefficients of the finest detail is 2r voxels wide, one more for rounding.
  const auto longest = static_cast<double>(hierarchy.dims().Max());
  density.rate = std::clamp(Reach(voxels, density.fovea, hierarchy.dims().Max()) + 1, 1.0, longest);
  return density;
}

}  // namespace fovea::sensors
