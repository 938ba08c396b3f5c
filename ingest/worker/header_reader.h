#ifndef INGEST_WORKER_HEADER_READER_H_
#define INGEST_WORKER_HEADER_READER_H_

#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/file_format.h"
#include "ingest/protocol.h"
#include "ingest/worker/headers/dense_header.h"

namespace fovea::ingest {

/// Which reader a file set is for: headerless voxels if the hints say so, else by its first bytes,
/// its sidecar and its name. INVALID_ARGUMENT lists what can be read.
[[nodiscard]] StatusOr<FileFormat> ChooseFormat(const std::vector<std::string>& paths,
                                                const ReaderHints& hints);

/// The header of a file set of dense voxels.
[[nodiscard]] StatusOr<DenseHeader> ReadHeader(const std::vector<std::string>& paths,
                                               const ReaderHints& hints, FileFormat format);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADER_READER_H_
