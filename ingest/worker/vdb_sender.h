#ifndef INGEST_WORKER_VDB_SENDER_H_
#define INGEST_WORKER_VDB_SENDER_H_

#include <cstdint>

#include <openvdb/openvdb.h>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "ingest/channel.h"

/// Included by the VDB reader's source files only: the header is heavy.
namespace fovea::ingest {

[[nodiscard]] Box3 ToBox(const openvdb::CoordBBox& box);  // OpenVDB's boxes include their end

/// Whether SendGrid can send the grid: float, double, int32, int64, bool or mask.
[[nodiscard]] bool IsScalar(const openvdb::GridBase& grid);

/// Sends what the grid holds inside `extent` (not empty): the field's start, all that differs from
/// its fill value as blocks and tiles, its end. The fill is the value that most of the extent has
/// in whole tiles or leaves, so that a constant grid costs nothing. May throw.
[[nodiscard]] Status SendGrid(const openvdb::GridBase& grid, uint32_t index, const Box3& extent,
                              Channel* channel);

/// Empties a scalar grid that is done with. When it goes with its voxels, OpenVDB frees them with
/// all threads, and for few of them to wake these takes longer.
void FreeVoxels(openvdb::GridBase* grid);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_VDB_SENDER_H_
