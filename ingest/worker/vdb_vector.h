#ifndef INGEST_WORKER_VDB_VECTOR_H_
#define INGEST_WORKER_VDB_VECTOR_H_

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include <openvdb/openvdb.h>

/// Scalars of vector grids. Included by the VDB reader's source files only: the header is heavy.
namespace fovea::ingest {

enum class VectorPart { kX, kY, kZ, kMagnitude };

/// "x", "y", "z", "magnitude": what follows the '.' in the name of a scalar of a vector grid.
inline constexpr std::array<std::string_view, 4> kVectorPartNames{"x", "y", "z", "magnitude"};

/// Whether ScalarOf can read the grid: vectors of three floats, doubles or 32-bit integers.
[[nodiscard]] bool IsVector(const openvdb::GridBase& grid);

/// "velocity.x" as the name of its vector grid and the part; nothing if it is no such name.
struct VectorName {
  std::string grid;
  VectorPart part;
};
[[nodiscard]] std::optional<VectorName> ParseVectorName(const std::string& name);

/// A component or the length of the vectors, with the transform of the grid and its active voxels.
/// Components of a staggered grid (class "staggered") stand on the faces between voxels: they are
/// brought to the centres, as the mean of a voxel's two faces; a tile is taken as constant. May
/// throw.
[[nodiscard]] openvdb::FloatGrid::Ptr ScalarOf(const openvdb::GridBase& grid, VectorPart part);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_VDB_VECTOR_H_
