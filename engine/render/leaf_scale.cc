#include "engine/render/leaf_scale.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "engine/base/parallel.h"

namespace fovea::render {
namespace {

int32_t ToNumber(float x, float scale, float most) {
  // std::max returns its first argument where the second is NaN.
  return static_cast<int32_t>(std::min(most, scale * std::sqrt(std::max(0.0F, x)) + 0.5F));
}

/// Stays as it is: numbers hold it exactly.
bool IsEmpty(const Rgba& value) {
  return value.red == 0 && value.green == 0 && value.blue == 0 && value.alpha == 0;
}

float FromNumber(int32_t number, double scale) {
  return static_cast<float>(static_cast<double>(number) * number * scale);
}

}  // namespace

LeafNumbers ToNumbers(const Rgba& value, int bits) {
  const auto scale = static_cast<float>(1 << bits);
  const auto most = static_cast<float>(kMostLeafNumber);
  return {ToNumber(value.red, scale, most), ToNumber(value.green, scale, most),
          ToNumber(value.blue, scale, most), ToNumber(1 - value.alpha, scale, scale)};
}

Rgba FromNumbers(const LeafNumbers& numbers, int bits) {
  const double scale = std::ldexp(1.0, -2 * bits);
  return {FromNumber(numbers.red, scale), FromNumber(numbers.green, scale),
          FromNumber(numbers.blue, scale), 1 - FromNumber(numbers.transmittance, scale)};
}

void SnapLeaves(int threads, std::vector<FrameLevel>* levels) {
  constexpr int64_t kPixelsInPiece = 16384;
  for (FrameLevel& level : *levels) {
    const auto pixels = [&level](int64_t first, int64_t last) {
      for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(last); ++i) {
        Rgba& value = level.values[i];
        if (level.kinds[i] == PixelKind::kLeaf && !IsEmpty(value)) {
          value = FromNumbers(ToNumbers(value, kLeafBits), kLeafBits);
        }
      }
    };
    ParallelFor(0, static_cast<int64_t>(level.kinds.size()), kPixelsInPiece, threads,
                std::ref(pixels));
  }
}

}  // namespace fovea::render
