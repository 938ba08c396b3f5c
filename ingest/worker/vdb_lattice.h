#ifndef INGEST_WORKER_VDB_LATTICE_H_
#define INGEST_WORKER_VDB_LATTICE_H_

#include <openvdb/openvdb.h>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"

/// Where the voxels of a grid lie. Included by the VDB reader's source files only: the header is
/// heavy.
namespace fovea::ingest {

/// The matrix of a linear transform: from OpenVDB's index, which is the centre of a voxel.
[[nodiscard]] Matrix4 IndexToWorld(const openvdb::math::Transform& transform);

/// The grid on another lattice (the same kind of matrix, invertible), for `--registration world`:
/// itself if it lies so already; moved without loss if it is so many whole voxels away; else
/// resampled with trilinear interpolation, booleans and masks with the nearest voxel. Grids as
/// SendGrid takes them. May throw.
[[nodiscard]] StatusOr<openvdb::GridBase::Ptr> OnLattice(const openvdb::GridBase::Ptr& grid,
                                                         const Matrix4& lattice);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_VDB_LATTICE_H_
