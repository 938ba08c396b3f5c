#include "ingest/sensors/voxel_box.h"

#include <algorithm>
#include <cmath>

namespace fovea::ingest {
namespace {

constexpr double kFewestAlongLongest = 16, kMostAlongLongest = 512;
constexpr double kFewestAlongShort = 32;

/// The next larger number of two digits that matter: 1171.8 -> 1200.
double RoundedUp(double size) {
  const double unit = std::pow(10.0, std::floor(std::log10(size)) - 1);
  const double rounded = std::ceil(size / unit - 1e-9) * unit;
  return std::stod(fmt::format("{:.2g}", rounded));  // 0.1 + 0.2 is 0.3
}

Vec3 ChosenVoxel(const Vec3& lower, const Vec3& upper, const ReadingExtent& extent) {
  const Vec3 size = upper - lower;
  const double longest = std::max({size.x, size.y, size.z});
  if (!(longest > 0)) {
    return {1, 1, 1};  // all in one place
  }
  const double in_step = static_cast<double>(extent.readings) /
                         static_cast<double>(std::max<int64_t>(extent.steps, 1));
  const double along = std::clamp(std::sqrt(in_step), kFewestAlongLongest, kMostAlongLongest);
  const double edge = RoundedUp(longest / along);
  Vec3 voxel;
  for (int axis = 0; axis < 3; ++axis) {
    const bool flat = !(size[axis] > 0);
    voxel[axis] = flat ? edge : std::min(edge, RoundedUp(size[axis] / kFewestAlongShort));
  }
  return voxel;
}

StatusOr<sensors::VoxelGrid> WithVoxel(const Vec3& lower, const Vec3& upper, const Vec3& voxel,
                                       bool fits_exactly) {
  sensors::VoxelGrid grid;
  grid.lower = lower;
  grid.voxel = voxel;
  Int3 dims;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(voxel[axis] > 0) || !std::isfinite(voxel[axis])) {
      return InvalidArgument("--voxel: a size of {} must be more than 0", voxel[axis]);
    }
    const double count = (upper[axis] - lower[axis]) / voxel[axis];
    if (!(count <= static_cast<double>(kMaxDimension))) {
      return OutOfRange(
          "voxels of {} make {:.0f} of them along {}, more than {}: give larger ones (--voxel) or "
          "a "
          "smaller box (--bounds)",
          voxel[axis], count, "xyz"[axis], kMaxDimension);
    }
    // Readings on the upper face of chosen bounds are in the last voxel, which may be cut.
    dims[axis] = std::max<int64_t>(
        1, static_cast<int64_t>(fits_exactly ? std::llround(count) : std::ceil(count - 1e-6)));
  }
  FOVEA_ASSIGN_OR_RETURN(grid.hierarchy, Hierarchy::Make(dims));
  return grid;
}

}  // namespace

bool IsComplete(const SensorBox& box) {
  return box.bounds && (box.voxel || box.dims);
}

StatusOr<sensors::VoxelGrid> ChooseVoxels(const SensorBox& box, const ReadingExtent& extent) {
  if (!IsComplete(box) && extent.readings == 0) {
    return FailedPrecondition(
        "there is not one reading with a place and a value to choose a box from; look at "
        "--columns, or give --bounds and --voxel");
  }
  const Vec3 lower = box.bounds ? (*box.bounds)[0] : extent.lower;
  Vec3 upper = box.bounds ? (*box.bounds)[1] : extent.upper;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(upper[axis] >= lower[axis]) || !std::isfinite(upper[axis] - lower[axis])) {
      return InvalidArgument("--bounds: {} to {} along {} is no box", lower[axis], upper[axis],
                             "xyz"[axis]);
    }
  }
  if (!box.dims) {
    return WithVoxel(lower, upper, box.voxel ? *box.voxel : ChosenVoxel(lower, upper, extent),
                     /*fits_exactly=*/false);
  }
  Vec3 voxel;
  for (int axis = 0; axis < 3; ++axis) {
    const int64_t count = (*box.dims)[axis];
    if (count < 1 || count > kMaxDimension) {
      return InvalidArgument("--dims: {} voxels: each axis must be 1 to {}", count, kMaxDimension);
    }
    const double size = upper[axis] - lower[axis];
    voxel[axis] = size > 0 ? size / static_cast<double>(count) : 1;
    upper[axis] = lower[axis] + voxel[axis] * static_cast<double>(count);
  }
  return WithVoxel(lower, upper, voxel, /*fits_exactly=*/true);
}

std::string BoxFlags(const sensors::VoxelGrid& grid) {
  const Vec3 upper = grid.IndexToWorld().TransformPoint(
      {static_cast<double>(grid.hierarchy.dims().x), static_cast<double>(grid.hierarchy.dims().y),
       static_cast<double>(grid.hierarchy.dims().z)});
  return fmt::format("--bounds {},{},{},{},{},{} --voxel {},{},{}", grid.lower.x, grid.lower.y,
                     grid.lower.z, upper.x, upper.y, upper.z, grid.voxel.x, grid.voxel.y,
                     grid.voxel.z);
}

StatusOr<sensors::VoxelGrid> VoxelsOfStore(const Hierarchy& hierarchy,
                                           const Matrix4& index_to_world) {
  sensors::VoxelGrid grid;
  grid.hierarchy = hierarchy;
  for (int axis = 0; axis < 3; ++axis) {
    grid.voxel[axis] = index_to_world.m[5 * axis];
    grid.lower[axis] = index_to_world.m[4 * axis + 3];
  }
  if (grid.IndexToWorld() != index_to_world || !(grid.voxel.x > 0) || !(grid.voxel.y > 0) ||
      !(grid.voxel.z > 0)) {
    return FailedPrecondition(
        "its voxels are turned or mirrored in the world: no readings can be "
        "added to it");
  }
  return grid;
}

}  // namespace fovea::ingest
