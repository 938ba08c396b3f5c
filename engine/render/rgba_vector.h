#ifndef ENGINE_RENDER_RGBA_VECTOR_H_
#define ENGINE_RENDER_RGBA_VECTOR_H_

#include <bit>
#include <cstdint>
#include <cstring>

#include "engine/render/image.h"

/// A colour in one 128-bit register, by GCC's and Clang's vector extension: + - * act on all four
/// channels. Every x86-64 has these registers and nothing is contracted, so that the bits are the
/// same on all machines without dispatch; channels never mix, so that wider ones would gain little.
namespace fovea::render {

using RgbaVector = float __attribute__((vector_size(16)));

inline RgbaVector Load(const Rgba& from) {
  RgbaVector v;
  std::memcpy(&v, &from, sizeof(v));
  return v;
}

inline void Store(RgbaVector v, Rgba* to) {
  std::memcpy(static_cast<void*>(to), &v, sizeof(v));
}
inline void Store(RgbaVector v, float* to) {
  std::memcpy(static_cast<void*>(to), &v, sizeof(v));
}

/// Each channel's absolute value.
inline RgbaVector Absolute(RgbaVector v) {
  using Bits = int32_t __attribute__((vector_size(16)));
  const Bits magnitude = {0x7fffffff, 0x7fffffff, 0x7fffffff, 0x7fffffff};
  return std::bit_cast<RgbaVector>(std::bit_cast<Bits>(v) & magnitude);
}

/// Whether a > b in any channel.
inline bool AnyGreater(RgbaVector a, RgbaVector b) {
  using Halves = int64_t __attribute__((vector_size(16)));
  const auto greater = std::bit_cast<Halves>(a > b);
  return (greater[0] | greater[1]) != 0;
}

inline RgbaVector Mix(RgbaVector a, RgbaVector b, float f) {
  return a + f * (b - a);
}

}  // namespace fovea::render

#endif  // ENGINE_RENDER_RGBA_VECTOR_H_
