// FOVEATED frames as a client gets them: with their checksum mended, so that what is behind it is
// reached.

#include <cstring>

#include "service/frames/deflate.h"
#include "service/frames/foveated_codec.h"
#include "tests/fuzz/input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fovea;
  std::string bytes(reinterpret_cast<const char*>(data), size);
  (void)frames::DecodeFoveated(bytes).ok();
  if (bytes.size() >= sizeof(uint32_t)) {
    const size_t end = bytes.size() - sizeof(uint32_t);
    const uint32_t crc = frames::Crc32(std::string_view(bytes).substr(0, end));
    std::memcpy(bytes.data() + end, &crc, sizeof(crc));
  }
  auto picture = frames::DecodeFoveated(bytes);
  if (!picture.ok()) {
    return 0;
  }
  // What was read is written and read again the same. Another zlib stream may hold the same frame.
  const auto again = frames::EncodeFoveated(*picture);
  if (again.ok()) {
    fuzz::Require(frames::DecodeFoveated(*again).ok());
  }
  constexpr int kMostSide = 64;  // so that an input takes no longer than a moment
  if (picture->width_px() <= kMostSide && picture->height_px() <= kMostSide) {
    (void)frames::ExpandImage(*std::move(picture), 1);
  }
  return 0;
}
