#ifndef ENGINE_RENDER_SMOOTH_H_
#define ENGINE_RENDER_SMOOTH_H_

#include <vector>

#include "engine/render/combine.h"

namespace fovea::render {

/// One level of the foveated image, ready to be interpolated: each pixel's value times its weight,
/// and the weight. It is 1 inside, falls to 0 over a few pixels towards the edge of what the level
/// has, and is 1 with a transparent value where there is no volume.
struct SmoothLevel {
  LevelPlan plan;
  std::vector<Rgba> weighted;
  std::vector<float> weights;
};

/// Space-variant smoothing, Yu et al., section 5: the foveated image rebuilt with a smooth basis
/// instead of Haar's boxes. At a point p the value is, from coarse to fine,
///   v_l(p) = (1 - w_l(p)) v_{l-1}(p) + (w a)_l(p),
/// w_l and (w a)_l the bilinear interpolants of level l. Thick pixels are smoothed over their own
/// width; where the finest level has all four taps the value is that level's alone.
[[nodiscard]] std::vector<SmoothLevel> Smooth(const std::vector<PyramidLevel>& pyramid);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SMOOTH_H_
