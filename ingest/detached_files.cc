#include "ingest/detached_files.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "ingest/protocol.h"

namespace fovea::ingest {

namespace fs = std::filesystem;

StatusOr<std::vector<std::string>> FindDetached(const std::string& header,
                                                const std::vector<std::string>& names) {
  std::vector<std::string> found;
  for (const std::string& name : names) {
    const fs::path path(name);
    if (name.empty() || name.find('\0') != std::string::npos || path.is_absolute() ||
        std::find(path.begin(), path.end(), "..") != path.end()) {
      return InvalidArgument(
          "{}: its data are said to be in '{}': they must lie beside the header or below its "
          "folder, named without '..'; move them there and correct the header",
          header, Printable(name));
    }
    const fs::path beside = (fs::path(header).parent_path() / path).lexically_normal();
    std::error_code error;
    if (!fs::is_regular_file(beside, error)) {
      return NotFound("{}: its data file '{}' is not there", header, Printable(beside.string()));
    }
    found.push_back(beside.string());
  }
  return found;
}

}  // namespace fovea::ingest
