#ifndef SERVICE_ACCESS_TOKEN_FILE_H_
#define SERVICE_ACCESS_TOKEN_FILE_H_

#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "service/access/token.h"

/// The file that says which tokens a server takes: JSON, described in docs/operations.md.
namespace fovea::access {

inline constexpr size_t kMaxTokens = 10'000;

/// Every name and every digest is there once. INVALID_ARGUMENT saying which entry is wrong, and
/// how; an unknown key is wrong, too.
[[nodiscard]] StatusOr<std::vector<Token>> ParseTokens(std::string_view json);
[[nodiscard]] std::string FormatTokens(const std::vector<Token>& tokens);

/// NOT_FOUND if there is no such file; INVALID_ARGUMENT as ParseTokens, with the path.
[[nodiscard]] StatusOr<std::vector<Token>> ReadTokenFile(const std::string& path);
/// Replaces the file as a whole; only its owner can read it.
[[nodiscard]] Status WriteTokenFile(const std::string& path, const std::vector<Token>& tokens);

/// INVALID_ARGUMENT, naming the key, for what an entry cannot hold.
[[nodiscard]] Status CheckToken(const Token& token);

}  // namespace fovea::access

#endif  // SERVICE_ACCESS_TOKEN_FILE_H_
