#include "ingest/worker/vdb_vector.h"

#include <cmath>

namespace fovea::ingest {
namespace {

using VectorGrids = openvdb::TypeList<openvdb::Vec3SGrid, openvdb::Vec3DGrid, openvdb::Vec3IGrid>;

float PartOf(const openvdb::Vec3d& vector, VectorPart part) {
  // Of doubles: the squares of large floats overflow.
  return static_cast<float>(part == VectorPart::kMagnitude ? vector.length()
                                                           : vector[static_cast<int>(part)]);
}

/// The vector at the centre of a voxel of a staggered grid.
template <typename Accessor>
openvdb::Vec3d AtCentre(const Accessor& vectors, const openvdb::Coord& at) {
  const openvdb::Vec3d low(vectors.getValue(at));
  const openvdb::Vec3d high(vectors.getValue(at.offsetBy(1, 0, 0))[0],
                            vectors.getValue(at.offsetBy(0, 1, 0))[1],
                            vectors.getValue(at.offsetBy(0, 0, 1))[2]);
  return (low + high) * 0.5;
}

template <typename VectorGrid>
openvdb::FloatGrid::Ptr Scalars(const VectorGrid& grid, VectorPart part) {
  const openvdb::Vec3d background(grid.background());
  auto scalars = openvdb::FloatGrid::create(PartOf(background, part));
  scalars->setTransform(grid.transform().copy());
  const bool staggered = grid.getGridClass() == openvdb::GRID_STAGGERED;
  const auto vectors = grid.getConstAccessor();
  auto out = scalars->getAccessor();
  for (auto value = grid.cbeginValueOn(); value; ++value) {
    if (!value.isVoxelValue()) {
      out.addTile(value.getLevel(), value.getBoundingBox().min(),
                  PartOf(openvdb::Vec3d(*value), part), /*active=*/true);
      continue;
    }
    const openvdb::Coord at = value.getCoord();
    out.setValueOn(at, PartOf(staggered ? AtCentre(vectors, at) : openvdb::Vec3d(*value), part));
  }
  return scalars;
}

}  // namespace

bool IsVector(const openvdb::GridBase& grid) {
  return grid.isType<openvdb::Vec3SGrid>() || grid.isType<openvdb::Vec3DGrid>() ||
         grid.isType<openvdb::Vec3IGrid>();
}

std::optional<VectorName> ParseVectorName(const std::string& name) {
  const size_t dot = name.rfind('.');
  if (dot == std::string::npos) {
    return std::nullopt;
  }
  for (size_t i = 0; i < kVectorPartNames.size(); ++i) {
    if (name.substr(dot + 1) == kVectorPartNames[i]) {
      return VectorName{name.substr(0, dot), static_cast<VectorPart>(i)};
    }
  }
  return std::nullopt;
}

openvdb::FloatGrid::Ptr ScalarOf(const openvdb::GridBase& grid, VectorPart part) {
  openvdb::FloatGrid::Ptr scalars;
  grid.apply<VectorGrids>([&](const auto& typed) { scalars = Scalars(typed, part); });
  return scalars;
}

}  // namespace fovea::ingest
