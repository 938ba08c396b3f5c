#include "engine/render/smooth.h"

#include <algorithm>

#include "engine/base/parallel.h"

namespace fovea::render {
namespace {

/// Pixels beyond a level's own that are kept around it: they follow the coarser level, or are
/// transparent where there is no volume.
constexpr int64_t kMargin = 2;
/// Pixels from the edge of a level's own over which it takes over from the coarser level.
constexpr int kTaper = 3;

void AddScaled(const Rgba& from, float weight, Rgba* to) {
  to->red += weight * from.red;
  to->green += weight * from.green;
  to->blue += weight * from.blue;
  to->alpha += weight * from.alpha;
}

/// Bilinear upsampling: a child's centre lies a quarter of a parent off its parent's centre.
Rgba Upsampled(const SmoothLevel& coarser, int64_t u, int64_t v) {
  const int64_t pu = u >> 1;
  const int64_t pv = v >> 1;
  const int64_t du = (u & 1) != 0 ? 1 : -1;
  const int64_t dv = (v & 1) != 0 ? 1 : -1;
  Rgba sum;
  AddScaled(coarser.At(pu, pv), 9.0F / 16, &sum);
  AddScaled(coarser.At(pu + du, pv), 3.0F / 16, &sum);
  AddScaled(coarser.At(pu, pv + dv), 3.0F / 16, &sum);
  AddScaled(coarser.At(pu + du, pv + dv), 1.0F / 16, &sum);
  return sum;
}

/// For each pixel of the level, how much of its own value counts: 1 from kTaper pixels inside the
/// edge of what is present, 0 where it is not present. Where there is no volume there is no edge.
std::vector<float> TaperOf(const PyramidLevel& level) {
  const Rect& rect = level.plan.rect;
  const auto distance_outside = [](bool is_void) { return is_void ? kTaper : 0; };
  std::vector<int> distance(level.present.size());
  const auto at = [&](int64_t u, int64_t v) {
    if (u < rect.u0) {
      return distance_outside(level.plan.void_u0);
    }
    if (u >= rect.u1) {
      return distance_outside(level.plan.void_u1);
    }
    if (v < rect.v0) {
      return distance_outside(level.plan.void_v0);
    }
    if (v >= rect.v1) {
      return distance_outside(level.plan.void_v1);
    }
    return distance[level.Index(u, v)];
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

/// How the pixel (u, v) of a level's smoothed image is made.
enum class Origin { kOwn, kCoarser, kVoid };

Origin OriginOf(const LevelPlan& plan, int64_t u, int64_t v) {
  const Rect& rect = plan.rect;
  if ((u < rect.u0 && plan.void_u0) || (u >= rect.u1 && plan.void_u1) ||
      (v < rect.v0 && plan.void_v0) || (v >= rect.v1 && plan.void_v1)) {
    return Origin::kVoid;
  }
  return rect.Contains(u, v) ? Origin::kOwn : Origin::kCoarser;
}

/// One level from the coarser one, which is null for level 0.
SmoothLevel Refine(const SmoothLevel* coarser, const PyramidLevel& level, int threads) {
  const Rect& own = level.plan.rect;
  SmoothLevel result;
  result.rect = {own.u0 - kMargin, own.u1 + kMargin, own.v0 - kMargin, own.v1 + kMargin};
  result.width = level.plan.width;
  result.values.resize(static_cast<size_t>(result.rect.Width() * result.rect.Height()));
  const std::vector<float> taper = TaperOf(level);
  ParallelFor(result.rect.v0, result.rect.v1, 8, threads, [&](int64_t first, int64_t last) {
    for (int64_t v = first; v < last; ++v) {
      Rgba* row = result.values.data() + (v - result.rect.v0) * result.rect.Width();
      for (int64_t u = result.rect.u0; u < result.rect.u1; ++u, ++row) {
        const Origin origin = OriginOf(level.plan, u, v);
        if (origin == Origin::kVoid) {
          continue;
        }
        const size_t i = origin == Origin::kOwn ? level.Index(u, v) : 0;
        const float share = origin == Origin::kOwn ? taper[i] : 0.0F;
        if (share < 1) {
          AddScaled(Upsampled(*coarser, u, v), 1 - share, row);
        }
        if (share > 0) {
          AddScaled(level.values[i], share, row);
        }
      }
    }
  });
  return result;
}

}  // namespace

std::vector<SmoothLevel> Smooth(const std::vector<PyramidLevel>& pyramid, int threads) {
  std::vector<SmoothLevel> levels;
  for (const PyramidLevel& level : pyramid) {
    levels.push_back(Refine(levels.empty() ? nullptr : &levels.back(), level, threads));
  }
  return levels;
}

}  // namespace fovea::render
