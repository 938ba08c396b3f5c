#include "service/access/token_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <set>
#include <system_error>
#include <utility>

#include <nlohmann/json.hpp>

#include "service/wire/printable.h"

namespace fovea::access {
namespace {

using nlohmann::json;

constexpr size_t kMaxFileBytes = size_t{8} << 20;
constexpr size_t kMaxNameBytes = 64;
constexpr size_t kMaxPrefixBytes = 1024;
constexpr double kMaxQuota = 1e15;
constexpr const char* kKeys[] = {
    "name", "sha256", "prefix", "rights", "streams", "pixels_per_second", "bytes_in_per_second"};

StatusOr<std::string> Text(const json& entry, const char* key) {
  const auto found = entry.find(key);
  if (found == entry.end() || !found->is_string()) {
    return InvalidArgument("'{}' is missing, or no text", key);
  }
  return found->get<std::string>();
}

StatusOr<double> Quota(const json& entry, const char* key) {
  const auto found = entry.find(key);
  if (found == entry.end()) {
    return 0.0;
  }
  if (!found->is_number() || !(found->get<double>() > 0)) {
    return InvalidArgument("'{}' must be a number above 0, or left out for no limit", key);
  }
  return found->get<double>();
}

StatusOr<Digest> ParseDigest(std::string_view hex) {
  Digest digest;
  bool good = hex.size() == 2 * digest.size();
  for (size_t i = 0; good && i < digest.size(); ++i) {
    const char* at = hex.data() + 2 * i;
    const auto [end, error] = std::from_chars(at, at + 2, digest[i], 16);
    good = error == std::errc() && end == at + 2;
  }
  if (!good) {
    return InvalidArgument("'sha256' must be 64 hexadecimal digits, of the token's SHA-256");
  }
  return digest;
}

StatusOr<Token> ParseToken(const json& entry) {
  if (!entry.is_object()) {
    return InvalidArgument("must be an object");
  }
  for (const auto& [key, value] : entry.items()) {
    if (std::find(std::begin(kKeys), std::end(kKeys), key) == std::end(kKeys)) {
      return InvalidArgument("there is no key '{}'", wire::Printable(key));
    }
  }
  Token token;
  FOVEA_ASSIGN_OR_RETURN(token.name, Text(entry, "name"));
  FOVEA_ASSIGN_OR_RETURN(const std::string hex, Text(entry, "sha256"));
  FOVEA_ASSIGN_OR_RETURN(token.digest, ParseDigest(hex));
  FOVEA_ASSIGN_OR_RETURN(token.prefix, Text(entry, "prefix"));
  FOVEA_ASSIGN_OR_RETURN(const std::string rights, Text(entry, "rights"));
  if (rights != "read" && rights != "write") {
    return InvalidArgument("'rights' must be \"read\" or \"write\"");
  }
  token.right = rights == "write" ? Right::kWrite : Right::kRead;
  FOVEA_ASSIGN_OR_RETURN(const double streams, Quota(entry, "streams"));
  if (streams != std::floor(streams) || streams > 1e6) {
    return InvalidArgument("'streams' must be a whole number, 1 to 1000000");
  }
  token.quotas.streams = static_cast<int64_t>(streams);
  FOVEA_ASSIGN_OR_RETURN(token.quotas.pixels_per_second, Quota(entry, "pixels_per_second"));
  FOVEA_ASSIGN_OR_RETURN(token.quotas.bytes_in_per_second, Quota(entry, "bytes_in_per_second"));
  FOVEA_RETURN_IF_ERROR(CheckToken(token));
  return token;
}

json ToJson(const Token& token) {
  std::string hex;
  for (const uint8_t byte : token.digest) {
    hex += fmt::format("{:02x}", byte);
  }
  json entry = {{"name", token.name},
                {"sha256", hex},
                {"prefix", token.prefix},
                {"rights", token.right == Right::kWrite ? "write" : "read"}};
  if (token.quotas.streams > 0) {
    entry["streams"] = token.quotas.streams;
  }
  if (token.quotas.pixels_per_second > 0) {
    entry["pixels_per_second"] = token.quotas.pixels_per_second;
  }
  if (token.quotas.bytes_in_per_second > 0) {
    entry["bytes_in_per_second"] = token.quotas.bytes_in_per_second;
  }
  return entry;
}

/// JSON holds nothing else.
bool IsUtf8(const std::string& text) {
  try {
    return !json(text).dump().empty();
  } catch (const json::exception&) {
    return false;
  }
}

/// Whether a dataset can be named so, or lie below: parts that are not empty and do not begin with
/// '.'. Empty: all can.
bool CanBeDatasets(const std::string& prefix) {
  const std::string parts = "/" + prefix + "/";
  return prefix.empty() || (parts.find("//") == std::string::npos &&
                            parts.find("/.") == std::string::npos && IsUtf8(prefix));
}

std::string Reason(int error) {
  return std::generic_category().message(error);
}

}  // namespace

Status CheckToken(const Token& token) {
  const auto is_word = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '_' || c == '.';
  };
  if (token.name.empty() || token.name.size() > kMaxNameBytes ||
      !std::all_of(token.name.begin(), token.name.end(), is_word)) {
    return InvalidArgument("'name' must be 1 to {} letters, digits, '-', '_' or '.'",
                           kMaxNameBytes);
  }
  if (token.prefix.size() > kMaxPrefixBytes || !CanBeDatasets(token.prefix)) {
    return InvalidArgument(
        "'prefix' must be a dataset's name or a folder of datasets below the root ('lab/scans'), "
        "without '..', parts that begin with '.', or / at its ends; empty: all datasets");
  }
  if (token.quotas.streams < 0 || token.quotas.pixels_per_second > kMaxQuota ||
      token.quotas.bytes_in_per_second > kMaxQuota) {
    return InvalidArgument("quotas must be at most {:g}", kMaxQuota);
  }
  return absl::OkStatus();
}

StatusOr<std::vector<Token>> ParseTokens(std::string_view text) {
  const json file = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!file.is_object() || file.size() != 1 || !file.contains("tokens") ||
      !file["tokens"].is_array()) {
    return InvalidArgument(R"(must be JSON of the form {{"tokens": [...]}})");
  }
  const json& entries = file["tokens"];
  if (entries.size() > kMaxTokens) {
    return InvalidArgument("{} tokens are more than {}", entries.size(), kMaxTokens);
  }
  std::vector<Token> tokens;
  std::set<std::string> names;
  std::set<Digest> digests;
  for (size_t i = 0; i < entries.size(); ++i) {
    auto token = ParseToken(entries[i]);
    FOVEA_RETURN_IF_ERROR(Annotate(token.status(), fmt::format("tokens[{}]", i)));
    if (!names.insert(token->name).second || !digests.insert(token->digest).second) {
      return InvalidArgument("tokens[{}]: its name or its sha256 is there twice", i);
    }
    tokens.push_back(*std::move(token));
  }
  return tokens;
}

std::string FormatTokens(const std::vector<Token>& tokens) {
  json entries = json::array();
  for (const Token& token : tokens) {
    entries.push_back(ToJson(token));
  }
  return json({{"tokens", entries}}).dump(2) + "\n";
}

StatusOr<std::vector<Token>> ReadTokenFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("token file '{}' cannot be read: {}", path, Reason(errno));
  }
  std::string text(kMaxFileBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(file.gcount()));
  if (text.size() > kMaxFileBytes) {
    return InvalidArgument("token file '{}' is larger than {} MiB", path, kMaxFileBytes >> 20U);
  }
  auto tokens = ParseTokens(text);
  FOVEA_RETURN_IF_ERROR(Annotate(tokens.status(), fmt::format("token file '{}'", path)));
  return tokens;
}

Status WriteTokenFile(const std::string& path, const std::vector<Token>& tokens) {
  const std::string text = FormatTokens(tokens);
  const std::string partial = fmt::format("{}.{}.partial", path, ::getpid());
  const int fd = open(partial.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600);
  if (fd < 0) {
    return FailedPrecondition("cannot write '{}': {}", partial, Reason(errno));
  }
  const bool written =
      write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && fsync(fd) == 0;
  const bool placed = close(fd) == 0 && written && rename(partial.c_str(), path.c_str()) == 0;
  if (!placed) {
    const int error = errno;
    unlink(partial.c_str());
    return FailedPrecondition("cannot write '{}': {}", path, Reason(error));
  }
  return absl::OkStatus();
}

}  // namespace fovea::access
