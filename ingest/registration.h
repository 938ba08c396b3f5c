#ifndef INGEST_REGISTRATION_H_
#define INGEST_REGISTRATION_H_

#include <string>

#include "engine/volume/geometry.h"

/// How grids whose transforms differ come to lie in one dataset. Matrices map a file's index, the
/// centre of a voxel, to the world.
namespace fovea::ingest {

/// What differs between two matrices beyond rounding (1e-6 of a voxel's size, or of the distance
/// from the origin), in words; empty: nothing.
[[nodiscard]] std::string Difference(const Matrix4& a, const Matrix4& b);

/// The voxels of `lattice` that a box of another grid's voxels reaches when it is resampled there,
/// trilinear interpolation included; just the moved box if the grids lie whole voxels apart.
/// Matrices must be invertible. At most +-2^31: what lies beyond is cut.
[[nodiscard]] Box3 BoxOnLattice(const Box3& box, const Matrix4& index_to_world,
                                const Matrix4& lattice);

/// a * translate(offset).
[[nodiscard]] Matrix4 Moved(const Matrix4& a, const Vec3& offset);

}  // namespace fovea::ingest

#endif  // INGEST_REGISTRATION_H_
