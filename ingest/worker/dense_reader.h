#ifndef INGEST_WORKER_DENSE_READER_H_
#define INGEST_WORKER_DENSE_READER_H_

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/file_format.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// Voxels that are all there, behind a header or none: kRaw, kNpy, kNrrd, kMetaImage. Errors do not
/// name the file (but its data files); the caller does.
[[nodiscard]] Status ScanDense(const ScanRequest& request, FileFormat format, Channel* channel);
/// Sends one step in slabs. Steps that are read in their order are read in one go.
[[nodiscard]] Status ReadDense(const ReadRequest& request, FileFormat format, Channel* channel);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_DENSE_READER_H_
