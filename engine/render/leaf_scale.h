#ifndef ENGINE_RENDER_LEAF_SCALE_H_
#define ENGINE_RENDER_LEAF_SCALE_H_

#include <cstdint>
#include <vector>

#include "engine/render/foveated_frame.h"

/// Leaf values as whole numbers, in steps that the eye sees alike: number q stands for
/// (q / 2^bits)^2. docs/formats/foveated-frame.md.
namespace fovea::render {

inline constexpr int kLeastLeafBits = 4, kMostLeafBits = 12;  // more would not fit in a float
/// What pictures of 8 bits are made from: a fifth of their own rounding at the most.
inline constexpr int kLeafBits = 11;

/// Colours are 0 to kMostLeafNumber (lit ones may pass 1), transmittance 0 to 2^bits.
struct LeafNumbers {
  int32_t red = 0, green = 0, blue = 0, transmittance = 0;
};
inline constexpr int32_t kMostLeafNumber = 32767;

/// `bits`: kLeastLeafBits to kMostLeafBits, here and below. NaN becomes 0.
[[nodiscard]] LeafNumbers ToNumbers(const Rgba& value, int bits);
/// ToNumbers of it gives the same numbers.
[[nodiscard]] Rgba FromNumbers(const LeafNumbers& numbers, int bits);

/// Holds every leaf to the nearest value that numbers of kLeafBits stand for.
void SnapLeaves(int threads, std::vector<FrameLevel>* levels);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_LEAF_SCALE_H_
