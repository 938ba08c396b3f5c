#include "engine/render/path_lengths.h"

#include <algorithm>
#include <cmath>

#include "engine/render/composite.h"

namespace fovea::render {
namespace {

/// 1 - T^ratio, for T at least 1e-7.
float LongerCover(float transmittance, float ratio) {
  return 1 - ExpNegative(ratio * std::log(std::max(transmittance, 1e-7F)));
}

}  // namespace

void LengthenInherited(const float* parent_paths, const float* child_paths, size_t count,
                       Inheritance* inherited) {
  for (size_t i = 0; i < 2 * count; ++i) {
    const float ratio = child_paths[i] / parent_paths[i / 2];
    inherited->depth[i] *= ratio;
    const float transmittance = inherited->transmittance[i];
    if (transmittance >= 1) {
      continue;
    }
    const float cover = LongerCover(transmittance, ratio);
    const float scale = cover / (1 - transmittance);
    inherited->red[i] *= scale;
    inherited->green[i] *= scale;
    inherited->blue[i] *= scale;
    inherited->transmittance[i] = 1 - cover;
  }
}

Rgba Lengthened(const Rgba& value, float ratio) {
  if (value.alpha <= 0) {
    return value;
  }
  const float alpha = std::min(value.alpha, 1.0F);
  const float cover = LongerCover(1 - alpha, ratio);
  const float scale = cover / alpha;
  return {scale * value.red, scale * value.green, scale * value.blue, cover};
}

void TakeCommonPath(const float* paths, size_t count, Rgba* values) {
  for (size_t i = 0; i < count; ++i) {
    values[i] = Lengthened(values[i], 1 / paths[i]);
  }
}

}  // namespace fovea::render
