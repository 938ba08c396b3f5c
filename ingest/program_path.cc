#include "ingest/program_path.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <vector>

namespace fovea::ingest {

StatusOr<std::string> FindProgram(const std::string& name) {
  namespace fs = std::filesystem;
  std::vector<fs::path> folders;
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  if (!error) {
    folders.push_back(self.parent_path());
    folders.push_back(self.parent_path().parent_path() / "libexec" / "fovea");
  }
  const char* libexec = std::getenv("FOVEA_LIBEXEC");  // NOLINT(concurrency-mt-unsafe)
  if (libexec != nullptr && *libexec != '\0') {
    folders.emplace_back(libexec);
  }
  std::string looked_in;
  for (const fs::path& folder : folders) {
    const fs::path candidate = folder / name;
    if (fs::is_regular_file(candidate, error) && ::access(candidate.c_str(), X_OK) == 0) {
      return candidate.string();
    }
    looked_in += fmt::format("{}'{}'", looked_in.empty() ? "" : ", ", folder.string());
  }
  return NotFound(
      "the program '{}' was not found in {}: put it there, or name its folder in FOVEA_LIBEXEC",
      name, looked_in);
}

}  // namespace fovea::ingest
