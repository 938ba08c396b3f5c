#include "engine/render/warp.h"

#include <algorithm>
#include <cmath>

#include "engine/base/parallel.h"

namespace fovea::render {
namespace {

/// Calls `sample(U, V)` (sheared coordinates, voxels) for every pixel of the picture.
template <typename Sample>
Image WarpWith(const ShearView& view, int width_px, int height_px, int threads,
               const Sample& sample) {
  Image image;
  image.width = width_px;
  image.height = height_px;
  image.rgba.resize(4 * static_cast<size_t>(width_px) * static_cast<size_t>(height_px));
  const std::array<double, 6>& m = view.warp;
  ParallelFor(0, height_px, 8, threads, [&](int64_t first, int64_t last) {
    for (int64_t j = first; j < last; ++j) {
      float* out = image.rgba.data() + 4 * j * width_px;
      for (int64_t i = 0; i < width_px; ++i, out += 4) {
        const auto column = static_cast<double>(i);
        const auto row = static_cast<double>(j);
        const Rgba value =
            sample(m[0] * column + m[1] * row + m[2], m[3] * column + m[4] * row + m[5]);
        out[0] = value.red;
        out[1] = value.green;
        out[2] = value.blue;
        out[3] = value.alpha;
      }
    }
  });
  return image;
}

Rgba Mix(const Rgba& a, const Rgba& b, float f) {
  const float g = 1 - f;
  return {g * a.red + f * b.red, g * a.green + f * b.green, g * a.blue + f * b.blue,
          g * a.alpha + f * b.alpha};
}

/// The value of the leaf that the voxel-wide pixel (u, v) lies in. `finest` is L.
Rgba LeafAt(const std::vector<PyramidLevel>& pyramid, int finest, int64_t u, int64_t v) {
  Rgba value;
  for (const PyramidLevel& level : pyramid) {
    const int shift = finest - level.plan.level;
    const int64_t lu = u >> shift;
    const int64_t lv = v >> shift;
    if (!level.plan.rect.Contains(lu, lv)) {
      break;
    }
    const size_t i = level.Index(lu, lv);
    if (level.split[i] == 0) {
      value = level.values[i];
      break;
    }
  }
  return value;
}

int FinestLevel(const PyramidLevel& coarsest) {
  int finest = 0;
  while ((int64_t{1} << finest) < coarsest.plan.width) {
    ++finest;
  }
  return finest;
}

}  // namespace

Image WarpLeaves(const std::vector<PyramidLevel>& pyramid, const ShearView& view, int width_px,
                 int height_px, int threads) {
  const int finest = FinestLevel(pyramid.front());
  return WarpWith(view, width_px, height_px, threads, [&](double at_u, double at_v) {
    const double floor_u = std::floor(at_u - 0.5);
    const double floor_v = std::floor(at_v - 0.5);
    const auto u = static_cast<int64_t>(floor_u);
    const auto v = static_cast<int64_t>(floor_v);
    const auto fu = static_cast<float>(at_u - 0.5 - floor_u);
    const auto fv = static_cast<float>(at_v - 0.5 - floor_v);
    return Mix(Mix(LeafAt(pyramid, finest, u, v), LeafAt(pyramid, finest, u + 1, v), fu),
               Mix(LeafAt(pyramid, finest, u, v + 1), LeafAt(pyramid, finest, u + 1, v + 1), fu),
               fv);
  });
}

namespace {

/// Bilinear in one level, if all four taps lie inside it.
bool SampleLevel(const SmoothLevel& level, double at_u, double at_v, Rgba* value) {
  const double x = at_u / static_cast<double>(level.width) - 0.5;
  const double y = at_v / static_cast<double>(level.width) - 0.5;
  const double floor_x = std::floor(x);
  const double floor_y = std::floor(y);
  const auto u = static_cast<int64_t>(floor_x);
  const auto v = static_cast<int64_t>(floor_y);
  if (!level.rect.Contains(u, v) || !level.rect.Contains(u + 1, v + 1)) {
    return false;
  }
  const auto fu = static_cast<float>(x - floor_x);
  const auto fv = static_cast<float>(y - floor_y);
  *value = Mix(Mix(level.At(u, v), level.At(u + 1, v), fu),
               Mix(level.At(u, v + 1), level.At(u + 1, v + 1), fu), fv);
  return true;
}

}  // namespace

Image WarpSmooth(const std::vector<SmoothLevel>& levels, const Rect& coarsest_rect,
                 const ShearView& view, int width_px, int height_px, int threads) {
  // Nothing is drawn farther than one voxel outside the sheared volume, however wide a pixel.
  const auto scale = static_cast<double>(levels.front().width);
  const double lo_u = static_cast<double>(coarsest_rect.u0) * scale - 1;
  const double hi_u = static_cast<double>(coarsest_rect.u1) * scale + 1;
  const double lo_v = static_cast<double>(coarsest_rect.v0) * scale - 1;
  const double hi_v = static_cast<double>(coarsest_rect.v1) * scale + 1;
  return WarpWith(view, width_px, height_px, threads, [&](double at_u, double at_v) {
    Rgba value;
    if (at_u < lo_u || at_u > hi_u || at_v < lo_v || at_v > hi_v) {
      return value;
    }
    for (size_t l = levels.size(); l-- > 0;) {
      if (SampleLevel(levels[l], at_u, at_v, &value)) {
        break;
      }
    }
    return value;
  });
}

}  // namespace fovea::render
