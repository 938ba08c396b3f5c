#ifndef ENGINE_RENDER_SMOOTH_H_
#define ENGINE_RENDER_SMOOTH_H_

#include <vector>

#include "engine/render/combine.h"

namespace fovea::render {

/// One level of the smoothed foveated image, row by row over `rect`: the level's own pixels and,
/// around them, a margin that continues the coarser level.
struct SmoothLevel {
  Rect rect;
  int64_t width = 1;  // voxels a pixel
  std::vector<Rgba> values;

  [[nodiscard]] const Rgba& At(int64_t u, int64_t v) const {
    return values[static_cast<size_t>((v - rect.v0) * rect.Width() + u - rect.u0)];
  }
};

/// Space-variant smoothing, O(leaf pixels): the foveated image rebuilt with a smooth basis instead
/// of Haar. Yu et al., section 5. Each level is the coarser one upsampled smoothly, with its own
/// values where it has pixels, tapered towards the edge of what it has. Pixels at least the taper
/// inside keep their value exactly.
[[nodiscard]] std::vector<SmoothLevel> Smooth(const std::vector<PyramidLevel>& pyramid,
                                              int threads);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SMOOTH_H_
