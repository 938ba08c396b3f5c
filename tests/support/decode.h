#ifndef TESTS_SUPPORT_DECODE_H_
#define TESTS_SUPPORT_DECODE_H_

#include <cstdint>
#include <string>
#include <vector>

namespace fovea::testing {

struct Decoded {
  int width = 0, height = 0;  // 0: could not be decoded
  std::vector<uint8_t> rgb;   // row 0 on top
};

/// With libpng's and libjpeg's own readers.
[[nodiscard]] Decoded DecodePng(const std::string& bytes);
[[nodiscard]] Decoded DecodeJpeg(const std::string& bytes);

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_DECODE_H_
