#include "ingest/ingest_checks.h"

#include <filesystem>
#include <system_error>

#include "engine/store/file.h"
#include "ingest/raw_format.h"

namespace fovea::ingest {

namespace fs = std::filesystem;

Status IsThere(const IngestOptions& options, const std::string& why) {
  return AlreadyExists("'{}' is there already{}: remove it, name another, or add to it (--append)",
                       options.output, why);
}

Status CheckIngestOptions(const IngestOptions& options) {
  if (options.output.empty()) {
    return InvalidArgument("no dataset to write was named");
  }
  if (options.chunk_edge != 8 && options.chunk_edge != 16 && options.chunk_edge != 32) {
    return InvalidArgument("chunk edge {}: must be 8, 16 or 32", options.chunk_edge);
  }
  if (options.raw) {
    FOVEA_RETURN_IF_ERROR(CheckRawFormat(*options.raw));
  }
  if (options.tolerance && (options.lossless || options.append)) {
    return InvalidArgument("tolerance: not with {}", options.lossless
                                                         ? "lossless, whose error is 0"
                                                         : "append: the store's own holds");
  }
  if (options.append && options.extent) {
    return InvalidArgument("an extent is for a new dataset: '{}' has its own", options.output);
  }
  if (options.append && !options.retain.empty()) {
    return InvalidArgument("windows to retain are for a new dataset: '{}' has its own",
                           options.output);
  }
  std::error_code error;
  const bool is_new = !fs::exists(options.output, error) || fs::is_empty(options.output, error);
  const bool is_ours = fs::exists(fs::path(options.output) / store::kLockName, error);
  return options.append || is_new || is_ours ? absl::OkStatus() : IsThere(options, "");
}

StatusOr<std::string> LosslessType(const std::vector<std::string>& source_types) {
  std::string needed = "int16";
  for (const std::string& type : source_types) {
    if (type == "uint16" || type == "int16") {
      needed = "int32";
    } else if (type != "uint8" && type != "int8") {
      return InvalidArgument(
          "lossless integer coefficients are made of voxels of 8 or 16 bits, not of {}", type);
    }
  }
  return needed;
}

}  // namespace fovea::ingest
