#ifndef SERVICE_JOBS_SAFE_PATH_H_
#define SERVICE_JOBS_SAFE_PATH_H_

#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"

/// Names that clients send, as paths below a folder that the server's owner chose. What lies
/// outside, by whatever way, is NOT_FOUND, as if it were not there.
namespace fovea::jobs {

/// The canonical path of a folder that a flag names. NOT_FOUND, FAILED_PRECONDITION name the flag.
[[nodiscard]] StatusOr<std::string> CanonicalFolder(const std::string& path, std::string_view flag);

/// Whether `path` is `root` or below it; both canonical.
[[nodiscard]] bool IsBelow(const std::string& path, const std::string& root);

/// `root`, canonical, and `name` below it. NOT_FOUND for an empty, absolute or too long name, parts
/// that are empty, '.' or '..' or begin with '.', control characters, and for folders that are
/// links out of the root. What is not there yet is no error.
[[nodiscard]] StatusOr<std::string> PathBelow(const std::string& root, std::string_view name);

/// NOT_FOUND for any of these paths that leads out of `root`, canonical, or is not there.
[[nodiscard]] Status CheckBelow(const std::string& root, const std::vector<std::string>& paths);

/// `text` without "ROOT/", wherever it stands in it: clients need not know where roots are.
[[nodiscard]] std::string WithoutFolder(std::string text, const std::string& root);

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_SAFE_PATH_H_
