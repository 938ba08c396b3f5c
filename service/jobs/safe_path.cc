#include "service/jobs/safe_path.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "service/wire/printable.h"

namespace fovea::jobs {
namespace {

namespace fs = std::filesystem;
constexpr size_t kMaxNameBytes = 1024;

bool IsSafeName(std::string_view name) {
  if (name.empty() || name.size() > kMaxNameBytes ||
      std::any_of(name.begin(), name.end(),
                  [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; })) {
    return false;
  }
  for (size_t at = 0; at <= name.size();) {
    const size_t end = std::min(name.find('/', at), name.size());
    if (end == at || name[at] == '.') {
      return false;
    }
    at = end + 1;
  }
  return true;
}

Status NotThere(std::string_view name) {
  return NotFound("'{}' is not there: name files below the server's folder for them",
                  wire::Printable(name));
}

}  // namespace

bool IsBelow(const std::string& path, const std::string& root) {
  const fs::path below = path;
  const fs::path above = root;
  return std::mismatch(above.begin(), above.end(), below.begin(), below.end()).first == above.end();
}

StatusOr<std::string> CanonicalFolder(const std::string& path, std::string_view flag) {
  std::error_code error;
  const fs::path canonical = fs::canonical(path, error);
  if (error) {
    return NotFound("{}: '{}' cannot be opened: {}", flag, path, error.message());
  }
  if (!fs::is_directory(canonical, error)) {
    return FailedPrecondition("{}: '{}' is not a folder", flag, path);
  }
  return canonical.string();
}

StatusOr<std::string> PathBelow(const std::string& root, std::string_view name) {
  if (!IsSafeName(name)) {
    return NotThere(name);
  }
  const fs::path path = fs::path(root) / name;
  std::error_code error;
  const fs::path folder = fs::weakly_canonical(path.parent_path(), error);
  if (error || !IsBelow(folder, root)) {
    return NotThere(name);
  }
  return path.string();
}

Status CheckBelow(const std::string& root, const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    std::error_code error;
    const fs::path canonical = fs::canonical(path, error);
    if (error || !IsBelow(canonical, root)) {
      return NotThere(WithoutFolder(path, root));
    }
  }
  return absl::OkStatus();
}

std::string WithoutFolder(std::string text, const std::string& root) {
  const std::string prefix = root.ends_with('/') ? root : root + "/";
  for (size_t at = 0; (at = text.find(prefix, at)) != std::string::npos;) {
    text.erase(at, prefix.size());
  }
  return text;
}

}  // namespace fovea::jobs
