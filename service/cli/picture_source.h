#ifndef SERVICE_CLI_PICTURE_SOURCE_H_
#define SERVICE_CLI_PICTURE_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/cli/commands.h"
#include "service/export/frame_provider.h"

namespace fovea::cli {

/// Opens what `render` and `export` were given: a dataset, a server's dataset, or foreign files,
/// which are ingested into the cache first unless they are there already.
[[nodiscard]] StatusOr<std::unique_ptr<exports::FrameProvider>> OpenPictures(
    const PictureInput& input, const OutputOptions& output);

/// Whether `path` is a dataset's folder: one that ends in .zarr or holds a zarr.json.
[[nodiscard]] bool IsDataset(const std::string& path);

/// Whether `inputs` is one dataset, there or not, and not foreign files.
[[nodiscard]] bool NamesDataset(const std::vector<std::string>& inputs);

/// The cache folder that `--cache` or the environment names.
[[nodiscard]] StatusOr<std::string> CacheFolder(const std::string& given);

/// NAME-HASH: the hash changes with any file's path, size or time and with how they are read.
[[nodiscard]] StatusOr<std::string> CacheName(const ingest::IngestOptions& options);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_PICTURE_SOURCE_H_
