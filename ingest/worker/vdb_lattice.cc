#include "ingest/worker/vdb_lattice.h"

#include <optional>
#include <type_traits>

#include <openvdb/tools/GridTransformer.h>
#include <openvdb/tools/Interpolation.h>

#include "ingest/worker/vdb_sender.h"

namespace fovea::ingest {
namespace {

openvdb::math::Transform::Ptr TransformOf(const Matrix4& matrix) {
  openvdb::math::Mat4d transposed;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      transposed(column, row) = matrix.m[static_cast<size_t>(4 * row + column)];
    }
  }
  return openvdb::math::Transform::createLinearTransform(transposed);
}

/// By how many whole voxels of `lattice` the grid lies away from it; nothing if it is turned,
/// scaled, or moved by parts of a voxel.
std::optional<openvdb::Coord> WholeVoxelsAway(const openvdb::math::Transform& from,
                                              const openvdb::math::Transform& to) {
  const openvdb::Vec3d origin = to.worldToIndex(from.indexToWorld(openvdb::Vec3d(0, 0, 0)));
  const openvdb::Coord away = openvdb::Coord::round(origin);
  for (int axis = 0; axis < 3; ++axis) {
    openvdb::Vec3d step(0, 0, 0);
    step[axis] = 1;
    const openvdb::Vec3d there = to.worldToIndex(from.indexToWorld(step));
    if (!(there - away.asVec3d() - step).eq(openvdb::Vec3d(0, 0, 0), 1e-4)) {
      return std::nullopt;
    }
  }
  return away;
}

template <typename GridT>
openvdb::GridBase::Ptr Moved(const GridT& grid, const openvdb::Coord& away) {
  auto moved = GridT::create(grid.background());
  auto out = moved->getAccessor();
  for (auto value = grid.cbeginValueAll(); value; ++value) {
    const openvdb::CoordBBox box = value.getBoundingBox();
    if (value.isVoxelValue()) {
      if (value.isValueOn() || *value != grid.background()) {
        const openvdb::Coord at = box.min() + away;
        value.isValueOn() ? out.setValueOn(at, *value) : out.setValueOff(at, *value);
      }
    } else if (value.isValueOn() || *value != grid.background()) {
      moved->tree().fill({box.min() + away, box.max() + away}, *value, value.isValueOn());
    }
  }
  return moved;
}

/// A mask has no values to interpolate or to move.
openvdb::BoolGrid::Ptr AsBool(const openvdb::MaskGrid& mask) {
  auto grid = openvdb::BoolGrid::create(false);
  grid->setTransform(mask.transform().copy());
  for (auto value = mask.cbeginValueOn(); value; ++value) {
    grid->tree().fill(value.getBoundingBox(), true, true);
  }
  return grid;
}

template <typename GridT>
openvdb::GridBase::Ptr Placed(const GridT& grid, const openvdb::math::Transform::Ptr& to) {
  if (const auto away = WholeVoxelsAway(grid.transform(), *to)) {
    auto moved = Moved(grid, *away);
    moved->setTransform(to);
    return moved;
  }
  auto resampled = GridT::create(grid.background());
  resampled->setTransform(to);
  using Sampler = std::conditional_t<std::is_same_v<GridT, openvdb::BoolGrid>,
                                     openvdb::tools::PointSampler, openvdb::tools::BoxSampler>;
  openvdb::tools::resampleToMatch<Sampler>(grid, *resampled);
  return resampled;
}

}  // namespace

// OpenVDB multiplies row vectors, so its matrix is transposed.
Matrix4 IndexToWorld(const openvdb::math::Transform& transform) {
  const openvdb::math::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  Matrix4 result;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      result.m[static_cast<size_t>(4 * row + column)] = matrix(column, row);
    }
  }
  return result;
}

StatusOr<openvdb::GridBase::Ptr> OnLattice(const openvdb::GridBase::Ptr& grid,
                                           const Matrix4& lattice) {
  if (grid->isType<openvdb::MaskGrid>()) {
    return OnLattice(AsBool(static_cast<const openvdb::MaskGrid&>(*grid)), lattice);
  }
  const openvdb::math::Transform::Ptr to = TransformOf(lattice);
  const auto away = WholeVoxelsAway(grid->transform(), *to);
  if (away && *away == openvdb::Coord(0, 0, 0)) {
    return grid;
  }
  openvdb::GridBase::Ptr placed;
  grid->apply<openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                                openvdb::Int64Grid, openvdb::BoolGrid>>(
      [&](const auto& typed) { placed = Placed(typed, to); });
  if (placed == nullptr) {
    return InvalidArgument("a grid of type {} cannot be resampled", grid->valueType());
  }
  return placed;
}

}  // namespace fovea::ingest
