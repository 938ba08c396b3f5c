#ifndef SERVICE_CLI_INGEST_REMOTE_H_
#define SERVICE_CLI_INGEST_REMOTE_H_

#include "engine/base/status.h"
#include "service/cli/commands.h"

namespace fovea::cli {

/// `fovea ingest --server`: files are read here, their voxels go to a dataset of the server.
[[nodiscard]] Status UploadFiles(const IngestCommand& command);

/// INVALID_ARGUMENT names a flag that does not go with --server.
[[nodiscard]] Status CheckUpload(const IngestCommand& command);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_INGEST_REMOTE_H_
