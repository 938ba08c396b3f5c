#ifndef INGEST_WORKER_VDB_READER_H_
#define INGEST_WORKER_VDB_READER_H_

#include <string>

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// OpenVDB files. Errors do not name the file; the caller does. Damaged files are DATA_LOSS, what
/// needs more memory than the process may use is RESOURCE_EXHAUSTED. OpenVDB itself may crash.

/// Sends a FileInfo and a GridInfo for each grid, in the order of the file. Boxes come from the
/// metadata, and from the voxels where these say nothing credible or the request asks for it.
[[nodiscard]] Status ScanVdb(const ScanRequest& request, Channel* channel);

/// Sends what the wanted grids hold inside the extent: every voxel and tile, active or not.
[[nodiscard]] Status ReadVdb(const ReadRequest& request, Channel* channel);

/// "10.0.1"; empty in fovea-worker, whose ScanVdb and ReadVdb are errors.
[[nodiscard]] std::string OpenVdbVersion();

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_VDB_READER_H_
