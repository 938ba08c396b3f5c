#include "engine/render/smooth.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fovea::render {
namespace {

/// Pixels from the edge of a level's own over which it takes over from the coarser level.
constexpr int kTaper = 2;

/// For each pixel of the level, how much of its own value counts: 1 from kTaper pixels inside the
/// edge of what is present, 0 where it is not present. Where there is no volume there is no edge.
std::vector<float> TaperOf(const PyramidLevel& level) {
  const Rect& rect = level.plan.rect;
  std::vector<int> distance(level.present.size());
  const auto at = [&](int64_t u, int64_t v) {
    if (rect.Contains(u, v)) {
      return distance[level.Index(u, v)];
    }
    return level.plan.IsVoid(u, v) ? kTaper : 0;
  };
  // Chessboard distance to the nearest absent pixel, in two sweeps.
  for (int64_t v = rect.v0; v < rect.v1; ++v) {
    for (int64_t u = rect.u0; u < rect.u1; ++u) {
      const int near = std::min(std::min(at(u - 1, v), at(u - 1, v - 1)),
                                std::min(at(u, v - 1), at(u + 1, v - 1)));
      distance[level.Index(u, v)] =
          level.present[level.Index(u, v)] != 0 ? std::min(near + 1, kTaper) : 0;
    }
  }
  for (int64_t v = rect.v1 - 1; v >= rect.v0; --v) {
    for (int64_t u = rect.u1 - 1; u >= rect.u0; --u) {
      const int near = std::min(std::min(at(u + 1, v), at(u + 1, v + 1)),
                                std::min(at(u, v + 1), at(u - 1, v + 1)));
      int& own = distance[level.Index(u, v)];
      own = std::min(own, near + 1);
    }
  }
  std::vector<float> taper(distance.size());
  std::transform(distance.begin(), distance.end(), taper.begin(),
                 [](int d) { return static_cast<float>(d) / kTaper; });
  return taper;
}

/// At a sharp edge the step towards the inverse overshoots. It goes at most as far as half of the
/// value in any channel, in all channels alike, so that the hue stays.
Rgba Sharpened(const Rgba& own, const Rgba& step) {
  float scale = 1;
  for (const auto& [value, change] :
       {std::pair(own.red, step.red), std::pair(own.green, step.green),
        std::pair(own.blue, step.blue), std::pair(own.alpha, step.alpha)}) {
    if (std::abs(change) > 0.5F * value) {
      scale = std::min(scale, 0.5F * value / std::abs(change));
    }
  }
  return {own.red + scale * step.red, own.green + scale * step.green, own.blue + scale * step.blue,
          own.alpha + scale * step.alpha};
}

/// What is missing for the bilinear interpolant to have the pixel's own mean over the pixel, by one
/// step towards the inverse: the mean of an interpolant of means is 3/4 of its own and 1/8 of each
/// neighbour's, on either axis.
Rgba MeanDefect(const PyramidLevel& level, int64_t u, int64_t v) {
  constexpr float kShare[3] = {0.125F, 0.75F, 0.125F};
  const Rgba& own = level.values[level.Index(u, v)];
  const bool crosses = level.plan.crossing.Contains(u, v);
  Rgba defect;
  for (int tap = 0; tap < 9; ++tap) {
    const int64_t nu = u + tap % 3 - 1;
    const int64_t nv = v + tap / 3 - 1;
    // A neighbour across the volume's edge would draw the edge into this pixel.
    if (!level.plan.rect.Contains(nu, nv) || level.present[level.Index(nu, nv)] == 0 ||
        (crosses && !level.plan.crossing.Contains(nu, nv))) {
      continue;
    }
    const Rgba& other = level.values[level.Index(nu, nv)];
    const float share = kShare[tap % 3] * kShare[tap / 3];
    defect.red += share * (own.red - other.red);
    defect.green += share * (own.green - other.green);
    defect.blue += share * (own.blue - other.blue);
    defect.alpha += share * (own.alpha - other.alpha);
  }
  return defect;
}

/// Values whose bilinear interpolant nearly keeps each pixel's mean. Pixels one voxel wide stay as
/// they are.
std::vector<Rgba> MeanPreserving(const PyramidLevel& level) {
  std::vector<Rgba> values = level.values;
  const Rect& rect = level.plan.rect;
  for (int64_t v = rect.v0; level.plan.width > 1 && v < rect.v1; ++v) {
    for (int64_t u = rect.u0; u < rect.u1; ++u) {
      const size_t i = level.Index(u, v);
      if (level.present[i] != 0) {
        values[i] = Sharpened(level.values[i], MeanDefect(level, u, v));
      }
    }
  }
  return values;
}

}  // namespace

std::vector<SmoothLevel> Smooth(const std::vector<PyramidLevel>& pyramid) {
  std::vector<SmoothLevel> levels;
  for (const PyramidLevel& level : pyramid) {
    SmoothLevel& smooth = levels.emplace_back();
    smooth.plan = level.plan;
    smooth.weights = TaperOf(level);
    smooth.weighted.resize(level.values.size());
    const std::vector<Rgba> values = MeanPreserving(level);
    for (size_t i = 0; i < level.values.size(); ++i) {
      const float weight = smooth.weights[i];
      const Rgba& value = values[i];
      smooth.weighted[i] = {weight * value.red, weight * value.green, weight * value.blue,
                            weight * value.alpha};
    }
  }
  return levels;
}

}  // namespace fovea::render
