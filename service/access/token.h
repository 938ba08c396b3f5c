#ifndef SERVICE_ACCESS_TOKEN_H_
#define SERVICE_ACCESS_TOKEN_H_

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/status.h"

/// Who may do what on a server: bearer tokens, what each is good for, and how much of it.
namespace fovea::access {

/// SHA-256 of a token: all that is kept of it.
using Digest = std::array<uint8_t, 32>;

enum class Right { kRead, kWrite };  // kWrite includes kRead

/// 0: without limit.
struct Quotas {
  int64_t streams = 0;             // that run at once
  double pixels_per_second = 0;    // rendered
  double bytes_in_per_second = 0;  // of requests and uploads
  friend bool operator==(const Quotas&, const Quotas&) = default;
};

struct Token {
  std::string name;  // what people call it; not a secret
  Digest digest{};
  std::string prefix;  // a folder of datasets, or a dataset; empty: all
  Right right = Right::kRead;
  Quotas quotas;
  friend bool operator==(const Token&, const Token&) = default;
};

/// A new token: "fovea_" and 256 random bits in letters, digits, - and _. INTERNAL if the system
/// has no random bits.
[[nodiscard]] StatusOr<std::string> MakeToken();

[[nodiscard]] Digest DigestOf(std::string_view token);
/// In a time that says nothing about where they differ.
[[nodiscard]] bool SameDigest(const Digest& a, const Digest& b);

/// Whether the dataset `name` is `prefix` itself or lies below it, as a file in a folder.
[[nodiscard]] bool IsWithin(std::string_view name, std::string_view prefix);

}  // namespace fovea::access

#endif  // SERVICE_ACCESS_TOKEN_H_
