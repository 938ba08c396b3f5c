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
Rgba LeafAt(const std::vector<PyramidLevel>& pyramid, const Rect& sheet, int finest, int64_t u,
            int64_t v) {
  Rgba value;
  if (!sheet.Contains(u, v)) {
    return value;
  }
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

Image WarpLeaves(const std::vector<PyramidLevel>& pyramid, const Rect& sheet, const ShearView& view,
                 int width_px, int height_px, int threads) {
  const int finest = FinestLevel(pyramid.front());
  return WarpWith(view, width_px, height_px, threads, [&](double at_u, double at_v) {
    const double floor_u = std::floor(at_u - 0.5);
    const double floor_v = std::floor(at_v - 0.5);
    const auto u = static_cast<int64_t>(floor_u);
    const auto v = static_cast<int64_t>(floor_v);
    const auto fu = static_cast<float>(at_u - 0.5 - floor_u);
    const auto fv = static_cast<float>(at_v - 0.5 - floor_v);
    const auto leaf = [&](int64_t du, int64_t dv) {
      return LeafAt(pyramid, sheet, finest, u + du, v + dv);
    };
    return Mix(Mix(leaf(0, 0), leaf(1, 0), fu), Mix(leaf(0, 1), leaf(1, 1), fu), fv);
  });
}

namespace {

/// One level interpolated at a point: the sum of value times weight, and of the weights.
struct Interpolated {
  Rgba weighted;
  float weight = 0;
};

void AddScaled(const Rgba& from, float scale, Rgba* to) {
  to->red += scale * from.red;
  to->green += scale * from.green;
  to->blue += scale * from.blue;
  to->alpha += scale * from.alpha;
}

/// Bilinear. A tap where there is no volume counts as transparent between pixels one voxel wide,
/// as in the full-resolution picture; a wider pixel's neighbour in the void is left out, and the
/// others make up for it.
Interpolated Interpolate(const SmoothLevel& level, double at_u, double at_v) {
  const Rect& rect = level.plan.rect;
  const double x = at_u / static_cast<double>(level.plan.width) - 0.5;
  const double y = at_v / static_cast<double>(level.plan.width) - 0.5;
  const double floor_x = std::floor(x);
  const double floor_y = std::floor(y);
  const auto fu = static_cast<float>(x - floor_x);
  const auto fv = static_cast<float>(y - floor_y);
  const auto u = static_cast<int64_t>(floor_x);
  const auto v = static_cast<int64_t>(floor_y);
  const float shares[4] = {(1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv};
  Interpolated sum;
  float in_void = 0;
  for (int tap = 0; tap < 4; ++tap) {
    const int64_t tu = u + (tap & 1);
    const int64_t tv = v + (tap >> 1);
    if (rect.Contains(tu, tv)) {
      const auto i = static_cast<size_t>((tv - rect.v0) * rect.Width() + tu - rect.u0);
      AddScaled(level.weighted[i], shares[tap], &sum.weighted);
      sum.weight += shares[tap] * level.weights[i];
    } else if (level.plan.IsVoid(tu, tv)) {
      in_void += shares[tap];
    }
  }
  if (level.plan.width == 1) {
    sum.weight += in_void;
  } else if (in_void > 0 && in_void < 1) {
    const float scale = 1 / (1 - in_void);
    const Rgba kept = sum.weighted;
    sum.weighted = {};
    AddScaled(kept, scale, &sum.weighted);
    sum.weight *= scale;
  }
  return sum;
}

/// How much of a point lies within reach of the sheet's pixels, which end between pixel centres:
/// 1 inside, falling to 0 over the voxel around its edge.
float CoverOf(const Rect& sheet, double at_u, double at_v) {
  const double u =
      std::min(at_u - static_cast<double>(sheet.u0), static_cast<double>(sheet.u1) - at_u);
  const double v =
      std::min(at_v - static_cast<double>(sheet.v0), static_cast<double>(sheet.v1) - at_v);
  return static_cast<float>(std::clamp(u + 0.5, 0.0, 1.0) * std::clamp(v + 0.5, 0.0, 1.0));
}

}  // namespace

Image WarpSmooth(const std::vector<SmoothLevel>& levels, const Rect& sheet, const ShearView& view,
                 int width_px, int height_px, int threads) {
  return WarpWith(view, width_px, height_px, threads, [&](double at_u, double at_v) {
    Rgba value;
    const float cover = CoverOf(sheet, at_u, at_v);
    float left = cover > 0 ? 1 : 0;
    for (size_t l = levels.size(); l-- > 0 && left > 1e-6F;) {
      const Interpolated level = Interpolate(levels[l], at_u, at_v);
      AddScaled(level.weighted, levels[l].plan.width == 1 ? left : left * cover, &value);
      left *= 1 - level.weight;
    }
    return value;
  });
}

}  // namespace fovea::render
