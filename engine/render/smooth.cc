#include "engine/render/smooth.h"

#include <algorithm>

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

/// Values whose bilinear interpolant has, over each pixel, nearly the pixel's own mean: the mean
/// of an interpolant of means is 3/4 of its own and 1/8 of each neighbour's on either axis, and
/// what is missing is added (one step towards the inverse). Pixels one voxel wide stay as they are.
std::vector<Rgba> MeanPreserving(const PyramidLevel& level) {
  if (level.plan.width == 1) {
    return level.values;
  }
  constexpr float kShare[3] = {0.125F, 0.75F, 0.125F};
  const Rect& rect = level.plan.rect;
  std::vector<Rgba> values = level.values;
  for (int64_t v = rect.v0; v < rect.v1; ++v) {
    for (int64_t u = rect.u0; u < rect.u1; ++u) {
      if (level.present[level.Index(u, v)] == 0) {
        continue;
      }
      const Rgba& own = level.values[level.Index(u, v)];
      const bool crosses = level.plan.crossing.Contains(u, v);
      Rgba& value = values[level.Index(u, v)];
      for (int tap = 0; tap < 9; ++tap) {
        const int64_t nu = u + tap % 3 - 1;
        const int64_t nv = v + tap / 3 - 1;
        // A neighbour across the volume's edge would draw the edge into this pixel.
        if (!rect.Contains(nu, nv) || level.present[level.Index(nu, nv)] == 0 ||
            (crosses && !level.plan.crossing.Contains(nu, nv))) {
          continue;
        }
        const Rgba& other = level.values[level.Index(nu, nv)];
        const float share = kShare[tap % 3] * kShare[tap / 3];
        value.red += share * (own.red - other.red);
        value.green += share * (own.green - other.green);
        value.blue += share * (own.blue - other.blue);
        value.alpha += share * (own.alpha - other.alpha);
      }
      value = {std::max(value.red, 0.0F), std::max(value.green, 0.0F), std::max(value.blue, 0.0F),
               std::clamp(value.alpha, 0.0F, 1.0F)};
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
