#include "service/export/npy.h"

#include <fmt/format.h>

namespace fovea::exports {

std::string NpyHeader(const std::vector<int64_t>& shape) {
  constexpr size_t kPreamble = 10;  // magic, version, header length
  constexpr size_t kAlignment = 64;
  std::string text = "{'descr': '<f4', 'fortran_order': False, 'shape': (";
  for (const int64_t size : shape) {
    text += fmt::format("{},", size);
  }
  text += "), }";
  const size_t unpadded = kPreamble + text.size() + 1;
  text.append((kAlignment - unpadded % kAlignment) % kAlignment, ' ');
  text += '\n';
  std::string header("\x93NUMPY\x01\x00", 8);
  header += static_cast<char>(text.size() & 0xFF);
  header += static_cast<char>(text.size() >> 8);
  return header + text;
}

}  // namespace fovea::exports
