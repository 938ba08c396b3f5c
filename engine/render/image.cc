#include "engine/render/image.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace fovea::render {
namespace {

double SrgbFromLinear(double x) {
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

uint8_t ToByte(double x) {
  return static_cast<uint8_t>(std::floor(255 * std::clamp(x, 0.0, 1.0) + 0.5));
}

/// The linear value from which each sRGB byte starts: byte b is for thresholds[b] <= x <
/// thresholds[b + 1]. Exact.
std::array<float, 256> MakeThresholds() {
  std::array<float, 256> thresholds{};
  for (int b = 1; b < 256; ++b) {
    const double srgb = (b - 0.5) / 255;
    const double linear =
        srgb <= 12.92 * 0.0031308 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
    auto start = static_cast<float>(linear);
    while (ToByte(SrgbFromLinear(start)) < b) {
      start = std::nextafter(start, 2.0F);
    }
    while (ToByte(SrgbFromLinear(std::nextafter(start, 0.0F))) >= b) {
      start = std::nextafter(start, 0.0F);
    }
    thresholds[b] = start;
  }
  return thresholds;
}

/// Bytes by the first bits of the float: exponent and 7 bits of fraction. Steps of 1/128 are so
/// small that none holds two thresholds; one comparison tells on which side of it a value is.
class SrgbTable {
 public:
  SrgbTable() {
    const std::array<float, 256> thresholds = MakeThresholds();
    for (uint32_t i = 0; i < kEntries; ++i) {
      const auto start = std::bit_cast<float>(std::bit_cast<uint32_t>(kLowest) + (i << kShift));
      const auto above = std::upper_bound(thresholds.begin() + 1, thresholds.end(), start);
      entries_[i] = {above != thresholds.end() ? *above : 2.0F,
                     static_cast<uint32_t>(above - thresholds.begin() - 1)};
    }
  }

  /// NaN is 0.
  [[nodiscard]] uint8_t At(float linear) const {
    const float x = std::min(std::max(kLowest, linear), kHighest);
    const Entry& entry =
        entries_[(std::bit_cast<uint32_t>(x) - std::bit_cast<uint32_t>(kLowest)) >> kShift];
    return static_cast<uint8_t>(entry.byte + (x >= entry.next ? 1 : 0));
  }

 private:
  static constexpr float kLowest = 0x1p-13F;  // below the threshold of byte 1
  static constexpr float kHighest = 0x1.fffffep-1F;
  static constexpr int kShift = 16;
  static constexpr uint32_t kEntries = 13 << (23 - kShift);
  struct Entry {
    float next;  // from here on the byte is one more
    uint32_t byte;
  };
  std::array<Entry, kEntries> entries_;
};

uint8_t CoverByte(float cover) {
  return cover > 0 ? static_cast<uint8_t>(255.0 * std::min(cover, 1.0F) + 0.5) : 0;
}

}  // namespace

std::vector<uint8_t> ToSrgb8(const Image& image, const Color& background) {
  static const SrgbTable kTable;
  std::vector<uint8_t> bytes(image.rgba.size());
  const float* p = image.rgba.data();
  uint8_t* to = bytes.data();
  for (size_t pixels = image.rgba.size() / 4; pixels > 0; --pixels, p += 4, to += 4) {
    const float rest = 1.0F - p[3];
    to[0] = kTable.At(p[0] + rest * background.red);
    to[1] = kTable.At(p[1] + rest * background.green);
    to[2] = kTable.At(p[2] + rest * background.blue);
    to[3] = CoverByte(p[3]);
  }
  return bytes;
}

}  // namespace fovea::render
