#ifndef INGEST_WORKER_RAW_READER_H_
#define INGEST_WORKER_RAW_READER_H_

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// Headerless voxels. Errors do not name the file; the caller does.
[[nodiscard]] Status ScanRaw(const ScanRequest& request, Channel* channel);
/// Sends one step in slabs; never holds more than one of them.
[[nodiscard]] Status ReadRaw(const ReadRequest& request, Channel* channel);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_RAW_READER_H_
