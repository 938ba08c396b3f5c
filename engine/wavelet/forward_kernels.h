#ifndef ENGINE_WAVELET_FORWARD_KERNELS_H_
#define ENGINE_WAVELET_FORWARD_KERNELS_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "engine/volume/basis.h"

/// The forward transform of the children of one brick, compiled for every instruction set and
/// chosen at run time. All of them give the same bits: no step is fused or reordered. Value is
/// float, int16_t or int32_t.
namespace fovea::wavelet::internal {

/// How many coefficients beyond a brick the filters of a wavelet reach, on each side of an axis.
[[nodiscard]] constexpr int64_t MarginOf(Wavelet wavelet) {
  return wavelet == Wavelet::kHaar ? 0 : wavelet == Wavelet::kCdf53 ? 1 : 2;
}

/// The children of a brick and of a margin around it: 2 * (edge + 2 * margin) on each axis.
template <typename Value>
struct BlockInput {
  /// Child (x, y, z) of the block is slices[z][rows[y] + x].
  const Value* const* slices = nullptr;
  const int64_t* rows = nullptr;
  int64_t edge = 0;
  /// Which axes (x, y, z) have more than one sample; the others are not lifted.
  std::array<bool, 3> lift{true, true, true};
  /// Which axes of an integer basis round up.
  std::array<bool, 3> up{};
};

/// Cells of Value that TransformBlock needs to work in.
template <typename Value>
[[nodiscard]] size_t WorkCells(Wavelet wavelet, int64_t edge);

/// Fills low ([edge]^3) and detail ([7][edge]^3), both and `work` aligned to 64 bytes. Returns the
/// largest |detail|; not finite if a coefficient is not. Float bases with float, integer bases with
/// the others.
template <typename Value>
float TransformBlock(Wavelet wavelet, const BlockInput<Value>& in, Value* work, Value* low,
                     Value* detail);

}  // namespace fovea::wavelet::internal

#endif  // ENGINE_WAVELET_FORWARD_KERNELS_H_
