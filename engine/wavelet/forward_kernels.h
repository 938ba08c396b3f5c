#ifndef ENGINE_WAVELET_FORWARD_KERNELS_H_
#define ENGINE_WAVELET_FORWARD_KERNELS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "engine/volume/basis.h"

/// The forward transform of the children of bricks, compiled for every instruction set and
/// chosen at run time. All of them give the same bits: no step is fused or reordered. Value is
/// float, int16_t or int32_t.
namespace fovea::wavelet::internal {

/// How many coefficients beyond a brick the filters of a wavelet reach, on each side of an axis.
[[nodiscard]] constexpr int64_t MarginOf(Wavelet wavelet) {
  return wavelet == Wavelet::kHaar ? 0 : wavelet == Wavelet::kCdf53 ? 1 : 2;
}

/// The most values of a vector; rows in memory are padded to whole ones.
inline constexpr int64_t kLanes = 16;

/// How many bricks, neighbours along x, are transformed at once at most: wide enough for whole
/// cache lines of the source, narrow enough for the second-level cache.
template <typename Value>
[[nodiscard]] constexpr int64_t MostBricks(Wavelet wavelet) {
  return wavelet == Wavelet::kHaar ? 4 : 8 / int64_t{sizeof(Value)};
}

/// Child `to` of a row is a copy of child `from`.
struct CopiedChild {
  int64_t to = 0, from = 0;
};

/// The children of a strip of bricks and of a margin around it: 2 * (edge + 2 * margin) along y and
/// z, 2 * (bricks * edge + 2 * margin) along x.
template <typename Value>
struct StripInput {
  /// Child x, if it is one of [first, last), of row (y, z) is slices[z][rows[y] + x - first]. Both
  /// are even.
  const Value* const* slices = nullptr;
  const int64_t* rows = nullptr;
  int64_t first = 0, last = 0;
  /// How far, in values, the row of the strip that will probably be next is from that of this one;
  /// 0 if there is none.
  int64_t next = 0;
  /// The other children of a row; Haar has none.
  std::span<const CopiedChild> copied;
  int64_t edge = 0;
  int64_t bricks = 1;
  /// How many rows of coefficients along y, and slices along z, are wanted of a brick. Haar makes
  /// no others: their children need not be there, and what it fills is left as it was.
  int64_t wanted_y = INT64_MAX, wanted_z = INT64_MAX;
  /// Which axes (x, y, z) have more than one sample; the others are not lifted.
  std::array<bool, 3> lift{true, true, true};
  /// Which axes of an integer basis round up.
  std::array<bool, 3> up{};
};

/// Cells of Value that TransformStrip needs to work in.
template <typename Value>
[[nodiscard]] size_t WorkCells(Wavelet wavelet, int64_t edge);

/// Fills low ([bricks][edge]^3) and detail ([bricks][7][edge]^3), both and `work` aligned to 64
/// bytes, and largest: of each brick the largest |detail|, not finite if a coefficient is not.
/// Float bases with float, integer bases with the others.
template <typename Value>
void TransformStrip(Wavelet wavelet, const StripInput<Value>& in, Value* work, Value* low,
                    Value* detail, float* largest);

}  // namespace fovea::wavelet::internal

#endif  // ENGINE_WAVELET_FORWARD_KERNELS_H_
