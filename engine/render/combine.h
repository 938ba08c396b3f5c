#ifndef ENGINE_RENDER_COMBINE_H_
#define ENGINE_RENDER_COMBINE_H_

#include <vector>

#include "engine/render/image.h"
#include "engine/render/thick_ray.h"

namespace fovea::render {

/// A premultiplied colour with its cover, as in a picture.
struct Rgba {
  float red = 0, green = 0, blue = 0, alpha = 0;
};

/// One level of the foveated image: a value for every pixel the level has (for a split pixel the
/// mean of its children); `present` says which. Row by row over plan.rect.
struct PyramidLevel {
  LevelPlan plan;
  std::vector<Rgba> values;
  std::vector<uint8_t> present;
  std::vector<uint8_t> split;

  [[nodiscard]] size_t Index(int64_t u, int64_t v) const {
    return static_cast<size_t>((v - plan.rect.v0) * plan.rect.Width() + u - plan.rect.u0);
  }
};

/// Passes F and K of every split pixel down to its children and composites: a leaf pixel becomes
/// F_0 over F_1 ... over F_leaf over K_leaf ... over K_0. With `smooth_splitting` the children take
/// what they inherit from the split pixels around, interpolated (ALGORITHM, smooth splitting).
[[nodiscard]] std::vector<PyramidLevel> Combine(std::vector<Layer> layers, bool smooth_splitting,
                                                int threads);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_COMBINE_H_
