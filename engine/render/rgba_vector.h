#ifndef ENGINE_RENDER_RGBA_VECTOR_H_
#define ENGINE_RENDER_RGBA_VECTOR_H_

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

inline RgbaVector Mix(RgbaVector a, RgbaVector b, float f) {
  return a + f * (b - a);
}

}  // namespace fovea::render

#endif  // ENGINE_RENDER_RGBA_VECTOR_H_
