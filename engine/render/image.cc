#include "engine/render/image.h"

#include <algorithm>
#include <array>
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
/// thresholds[b + 1]. Exact, and a search in it is faster than a power for each value.
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

uint8_t SrgbByte(float linear) {
  static const std::array<float, 256> kThresholds = MakeThresholds();
  if (!(linear > 0)) {
    return 0;
  }
  const auto above = std::upper_bound(kThresholds.begin() + 1, kThresholds.end(), linear);
  return static_cast<uint8_t>(above - kThresholds.begin() - 1);
}

}  // namespace

std::vector<uint8_t> ToSrgb8(const Image& image, const Color& background) {
  std::vector<uint8_t> bytes(image.rgba.size());
  for (size_t i = 0; i + 3 < image.rgba.size(); i += 4) {
    const float* p = &image.rgba[i];
    const float rest = 1.0F - p[3];
    bytes[i] = SrgbByte(p[0] + rest * background.red);
    bytes[i + 1] = SrgbByte(p[1] + rest * background.green);
    bytes[i + 2] = SrgbByte(p[2] + rest * background.blue);
    bytes[i + 3] = ToByte(p[3]);
  }
  return bytes;
}

}  // namespace fovea::render
