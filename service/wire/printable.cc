#include "service/wire/printable.h"

#include <fmt/format.h>

namespace fovea::wire {

std::string Printable(std::string_view text, size_t max_bytes) {
  const auto continues = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) == 0x80U; };
  std::string result;
  for (const char c : text) {
    if (result.size() >= max_bytes && !continues(c)) {  // never in the middle of a character
      return result + "...";
    }
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7F) {
      result += fmt::format("\\x{:02x}", byte);
    } else {
      result += c;
    }
  }
  return result;
}

}  // namespace fovea::wire
