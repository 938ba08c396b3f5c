#include "service/cli/dataset_output.h"

#include <filesystem>
#include <system_error>

#include "service/cli/console.h"

namespace fovea::cli {

void PrepareOutput(const OutputOptions& output, const std::string& path) {
  std::filesystem::path dataset(path);
  if (!dataset.has_filename()) {
    dataset = dataset.parent_path();  // a trailing slash
  }
  if (dataset.extension() != ".zarr") {
    Note(output, fmt::format("note: '{}' does not end in .zarr: `fovea serve` lists only datasets "
                             "that do",
                             path));
  }
  const std::filesystem::path folder = dataset.parent_path();
  std::error_code ignored;  // what cannot be made is reported by the store, with its path
  if (!folder.empty() && std::filesystem::create_directories(folder, ignored)) {
    Note(output, fmt::format("note: made the folder '{}'", folder.string()));
  }
}

}  // namespace fovea::cli
