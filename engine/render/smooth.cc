#include "engine/render/smooth.h"

#include <algorithm>

namespace fovea::render {
namespace {

/// Pixels from the edge of a level's own over which it takes over from the coarser level.
constexpr int kTaper = 3;

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

}  // namespace

std::vector<SmoothLevel> Smooth(const std::vector<PyramidLevel>& pyramid) {
  std::vector<SmoothLevel> levels;
  for (const PyramidLevel& level : pyramid) {
    SmoothLevel& smooth = levels.emplace_back();
    smooth.plan = level.plan;
    smooth.weights = TaperOf(level);
    smooth.weighted.resize(level.values.size());
    for (size_t i = 0; i < level.values.size(); ++i) {
      const float weight = smooth.weights[i];
      const Rgba& value = level.values[i];
      smooth.weighted[i] = {weight * value.red, weight * value.green, weight * value.blue,
                            weight * value.alpha};
    }
  }
  return levels;
}

}  // namespace fovea::render
