#ifndef ENGINE_RENDER_COMPOSITE_H_
#define ENGINE_RENDER_COMPOSITE_H_

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "engine/render/renderer.h"
#include "engine/render/slab_kernel.h"
#include "engine/render/transfer_function.h"

/// The arithmetic of one sample, shared by the thick rays and the reference renderer.
namespace fovea::render {

/// Premultiplied colour gathered so far and the transmittance left.
struct Pixel {
  float red = 0, green = 0, blue = 0, transmittance = 1;
};

/// `near` over `far`.
inline Pixel Over(const Pixel& near, const Pixel& far) {
  const float t = near.transmittance;
  return {near.red + t * far.red, near.green + t * far.green, near.blue + t * far.blue,
          t * far.transmittance};
}

/// exp(x) for x <= 0 within 2 ulp, the same bits on every machine.
inline float ExpNegative(float x) {
  if (x < -87.0F) {
    return 0.0F;
  }
  const float t = x * 1.44269504F;
  const auto whole = static_cast<int32_t>(t - 0.5F);               // nearest, as t <= 0
  const float f = (t - static_cast<float>(whole)) * 0.693147181F;  // e^f is 2^(t - whole)
  float p = 1.0F / 5040;
  p = p * f + 1.0F / 720;
  p = p * f + 1.0F / 120;
  p = p * f + 1.0F / 24;
  p = p * f + 1.0F / 6;
  p = p * f + 0.5F;
  p = p * f + 1.0F;
  p = p * f + 1.0F;
  return p * std::bit_cast<float>((whole + 127) << 23);
}

/// Colour and extinction (per voxel length) of a value, interpolated in the table.
struct Classified {
  float red, green, blue, sigma;
};

inline Classified Classify(const TransferTable::Entry* entries, float offset, float scale,
                           float value) {
  // Written so that NaN lands on entry 0.
  float x = (value - offset) * scale;
  x = x > 0.0F ? x : 0.0F;
  x = x < static_cast<float>(TransferTable::kEntries - 1)
          ? x
          : static_cast<float>(TransferTable::kEntries - 1);
  const auto i = static_cast<int32_t>(x);
  const float f = x - static_cast<float>(i);
  const TransferTable::Entry& e = entries[i];
  return {e.red + f * e.red_slope, e.green + f * e.green_slope, e.blue + f * e.blue_slope,
          e.sigma + f * e.sigma_slope};
}

/// Composites a slab of optical depth `tau` behind what the pixel holds. Yu et al., eq. (3).
inline void Accumulate(const Classified& c, float tau, Pixel* pixel) {
  const float transmitted = ExpNegative(-tau);
  const float weight = pixel->transmittance * (1.0F - transmitted);
  pixel->red += weight * c.red;
  pixel->green += weight * c.green;
  pixel->blue += weight * c.blue;
  pixel->transmittance *= transmitted;
}

/// The weighting D and what is clipped away at the samples of one row of one slice. Positions are
/// relative to the fovea, in world axes, in units of the smallest voxel spacing.
struct WeightedRow {
  /// A half-space that is kept: at pixel i, a step s along the ray from the sample is inside where
  /// first + i * step + s * along >= 0.
  struct Side {
    double first = 0, step = 0, along = 0;
  };
  static constexpr int kMostSides = 1 + 6 + kMostClipPlanes;  // chop, a box, planes

  Weighting weighting;
  Vec3 first;         // sample of pixel 0
  Vec3 step;          // to the next pixel's sample
  double length = 0;  // path through the slab; its samples lie halfway
  std::array<Side, kMostSides> sides;
  int side_count = 0;

  void Keep(const Side& side) { sides[static_cast<size_t>(side_count++)] = side; }

  /// The part of the slab's path that no side cuts away. Section 4, chop.
  [[nodiscard]] float KeptLength(int64_t i) const {
    double near = -length / 2;
    double far = length / 2;
    for (int n = 0; n < side_count; ++n) {
      const Side& side = sides[static_cast<size_t>(n)];
      const double here = side.first + static_cast<double>(i) * side.step;
      if (side.along > 0) {
        near = std::max(near, -here / side.along);
      } else if (side.along < 0) {
        far = std::min(far, -here / side.along);
      } else if (here < 0) {
        return 0;
      }
    }
    return static_cast<float>(std::max(far - near, 0.0));
  }
  /// 1 / (1 + a distance). Section 4, falloff.
  [[nodiscard]] double Falloff(int64_t i) const {
    return 1 / (1 + weighting.falloff_per_voxel * Length(first + static_cast<double>(i) * step));
  }
};

/// Gradient shading at one sample: ambient, diffuse and specular light (Blinn and Phong) on the
/// isosurface, both of whose sides are lit. `gradient` in (u, v, k), per super-voxel of its level.
/// Where it is weak there is no surface, and colour stays as it is.
inline void Shade(const KernelLight& light, const std::array<float, 3>& gradient, Classified* c) {
  const float* m = light.gradient_to_world;
  std::array<float, 3> g{};
  float square = 0;
  for (size_t axis = 0; axis < 3; ++axis) {
    g[axis] =
        m[3 * axis] * gradient[0] + m[3 * axis + 1] * gradient[1] + m[3 * axis + 2] * gradient[2];
    square += g[axis] * g[axis];
  }
  const float strength = square / (square + light.weak_gradient);
  const float inverse = 1 / std::sqrt(square + 1e-30F);
  const auto facing = [&](const float* to) {
    return std::min(std::abs((g[0] * to[0] + g[1] * to[1] + g[2] * to[2]) * inverse), 1.0F);
  };
  const float lit = light.ambient + light.diffuse * (1 + strength * (facing(light.to_light) - 1));
  float gloss = facing(light.halfway);
  for (int n = 0; n < light.shininess_log2; ++n) {
    gloss *= gloss;
  }
  gloss *= light.specular * strength;
  for (float* channel : {&c->red, &c->green, &c->blue}) {
    *channel = std::min(*channel * lit + gloss, 1.0F);
  }
}

/// Optical depth of a slab of `length` under falloff: T = (1 - D alpha)^length.
inline float FalloffDepth(float sigma, double falloff, double length) {
  return static_cast<float>(-length *
                            std::log1p(falloff * std::expm1(-static_cast<double>(sigma))));
}

}  // namespace fovea::render

#endif  // ENGINE_RENDER_COMPOSITE_H_
