#include "service/access/token.h"

#include <sys/random.h>

#include <openssl/crypto.h>
#include <openssl/sha.h>

namespace fovea::access {

StatusOr<std::string> MakeToken() {
  constexpr char kLetters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
  constexpr size_t kSixBitLetters = 43;  // 258 bits
  std::array<uint8_t, kSixBitLetters> random{};
  if (getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) {
    return Internal("the system gave no random bits (getrandom)");
  }
  std::string token = "fovea_";
  for (const uint8_t byte : random) {
    token += kLetters[byte & 63U];
  }
  return token;
}

Digest DigestOf(std::string_view token) {
  Digest digest;
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest.data());
  return digest;
}

bool SameDigest(const Digest& a, const Digest& b) {
  return CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

bool IsWithin(std::string_view name, std::string_view prefix) {
  return prefix.empty() || name == prefix ||
         (name.size() > prefix.size() && name.starts_with(prefix) && name[prefix.size()] == '/');
}

}  // namespace fovea::access
