#include "tests/support/vdb_files.h"

#include <cmath>
#include <fstream>
#include <stdexcept>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointDataGrid.h>

namespace fovea::testing {
namespace {

openvdb::Coord ToCoord(const Int3& p) {
  return {static_cast<int>(p.x), static_cast<int>(p.y), static_cast<int>(p.z)};
}

template <typename GridT>
openvdb::GridBase::Ptr MakeGrid(const VdbGrid& spec) {
  using ValueT = typename GridT::ValueType;
  auto grid = GridT::create(static_cast<ValueT>(spec.background));
  for (const VdbFill& fill : spec.fills) {
    const openvdb::CoordBBox box(
        ToCoord(fill.box.lo), ToCoord({fill.box.hi.x - 1, fill.box.hi.y - 1, fill.box.hi.z - 1}));
    grid->tree().fill(box, static_cast<ValueT>(fill.value), fill.active);
  }
  for (const VdbVoxel& voxel : spec.voxels) {
    if (voxel.active) {
      grid->tree().setValueOn(ToCoord(voxel.at), static_cast<ValueT>(voxel.value));
    } else {
      grid->tree().setValueOff(ToCoord(voxel.at), static_cast<ValueT>(voxel.value));
    }
  }
  return grid;
}

template <typename GridT>
openvdb::GridBase::Ptr MakeVectors(const VdbGrid& spec) {
  using VectorT = typename GridT::ValueType;
  using ElementT = typename VectorT::value_type;
  auto grid = GridT::create();
  for (const VdbVoxel& voxel : spec.voxels) {
    grid->tree().setValueOn(
        ToCoord(voxel.at),
        VectorT(static_cast<ElementT>(voxel.vector.x), static_cast<ElementT>(voxel.vector.y),
                static_cast<ElementT>(voxel.vector.z)));
  }
  if (spec.staggered) {
    grid->setGridClass(openvdb::GRID_STAGGERED);
  }
  return grid;
}

openvdb::GridBase::Ptr MakeTyped(const VdbGrid& spec, const openvdb::GridPtrVec& before) {
  if (spec.type == "float" || spec.type == "half") {
    auto grid = MakeGrid<openvdb::FloatGrid>(spec);
    grid->setSaveFloatAsHalf(spec.type == "half");
    return grid;
  }
  if (spec.type == "double") {
    return MakeGrid<openvdb::DoubleGrid>(spec);
  }
  if (spec.type == "int32") {
    return MakeGrid<openvdb::Int32Grid>(spec);
  }
  if (spec.type == "int64") {
    return MakeGrid<openvdb::Int64Grid>(spec);
  }
  if (spec.type == "bool") {
    return MakeGrid<openvdb::BoolGrid>(spec);
  }
  if (spec.type == "mask") {
    auto grid = openvdb::MaskGrid::create();
    for (const VdbVoxel& voxel : spec.voxels) {
      grid->tree().setActiveState(ToCoord(voxel.at), voxel.active);
    }
    for (const VdbFill& fill : spec.fills) {
      grid->tree().fill({ToCoord(fill.box.lo),
                         ToCoord({fill.box.hi.x - 1, fill.box.hi.y - 1, fill.box.hi.z - 1})},
                        true, fill.active);
    }
    return grid;
  }
  if (spec.type == "vec3s") {
    return MakeVectors<openvdb::Vec3SGrid>(spec);
  }
  if (spec.type == "vec3d") {
    return MakeVectors<openvdb::Vec3DGrid>(spec);
  }
  if (spec.type == "vec3i") {
    return MakeVectors<openvdb::Vec3IGrid>(spec);
  }
  if (spec.type == "points") {
    return openvdb::points::PointDataGrid::create();
  }
  if (spec.type == "shared") {
    return before.at(0)->copyGrid();
  }
  throw std::invalid_argument("no such grid type: " + spec.type);
}

void SetTransform(const VdbGrid& spec, openvdb::GridBase* grid) {
  if (spec.frustum) {
    const openvdb::BBoxd box({0, 0, 0}, {10, 10, 10});
    grid->setTransform(openvdb::math::Transform::createFrustumTransform(box, 0.5, 10));
    return;
  }
  auto transform = openvdb::math::Transform::createLinearTransform(spec.voxel_size);
  transform->postScale(openvdb::Vec3d(spec.scale.x, spec.scale.y, spec.scale.z));
  if (spec.turn_deg != 0) {
    transform->postRotate(spec.turn_deg * std::acos(-1.0) / 180, openvdb::math::Z_AXIS);
  }
  transform->postTranslate({spec.origin.x, spec.origin.y, spec.origin.z});
  grid->setTransform(transform);
}

}  // namespace

void WriteVdb(const std::string& path, const std::vector<VdbGrid>& grids,
              const VdbFileOptions& options) {
  openvdb::initialize();
  openvdb::GridPtrVec made;
  for (const VdbGrid& spec : grids) {
    openvdb::GridBase::Ptr grid = MakeTyped(spec, made);
    grid->setName(spec.name);
    SetTransform(spec, grid.get());
    if (!spec.unit.empty()) {
      grid->insertMeta("world_unit", openvdb::StringMetadata(spec.unit));
    }
    if (options.declared_box) {
      const Box3& box = *options.declared_box;
      grid->insertMeta("file_bbox_min", openvdb::Vec3IMetadata(ToCoord(box.lo).asVec3i()));
      grid->insertMeta(
          "file_bbox_max",
          openvdb::Vec3IMetadata(ToCoord({box.hi.x - 1, box.hi.y - 1, box.hi.z - 1}).asVec3i()));
      grid->insertMeta("file_voxel_count", openvdb::Int64Metadata(1));
    }
    made.push_back(grid);
  }
  const bool stats = options.stats_metadata && !options.declared_box;
  if (options.grid_offsets) {
    openvdb::io::File file(path);
    file.setGridStatsMetadataEnabled(stats);
    file.write(made);
    file.close();
    return;
  }
  std::ofstream stream(path, std::ios::binary);
  openvdb::io::Stream archive(stream);
  archive.setGridStatsMetadataEnabled(stats);
  archive.write(made);
}

}  // namespace fovea::testing
