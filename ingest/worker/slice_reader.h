#ifndef INGEST_WORKER_SLICE_READER_H_
#define INGEST_WORKER_SLICE_READER_H_

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// Pictures as slices, through OpenImageIO (the picture module must have been loaded): all pages of
/// all files of the set, in order. With `slices_per_step` so many make a step; else of several
/// files of several pages each is a step; else all are one. Errors name the file that is odd.
[[nodiscard]] Status ScanSlices(const ScanRequest& request, Channel* channel);
[[nodiscard]] Status ReadSlices(const ReadRequest& request, Channel* channel);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_SLICE_READER_H_
