#ifndef ENGINE_RENDER_SMOOTH_SAMPLE_H_
#define ENGINE_RENDER_SMOOTH_SAMPLE_H_

#include "engine/render/rgba_vector.h"
#include "engine/render/smooth.h"

/// One level of the smoothed image at a point, for whoever walks over pixels.
namespace fovea::render {

inline RgbaVector Bilinear(const Rgba* row0, const Rgba* row1, float fu, float fv) {
  return Mix(Mix(Load(row0[0]), Load(row0[1]), fu), Mix(Load(row1[0]), Load(row1[1]), fu), fv);
}

/// Where taps are counted from, in pixels: bilinear ones from pixel centres, splines' from edges.
inline double TapOrigin(Basis basis) {
  return basis == Basis::kBilinear ? 0.5 : 0.0;
}

/// Quadratic B-spline weights of the pixel before, the one that holds the point, and the one after.
struct SplineWeights {
  explicit SplineWeights(float f)
      : before(0.5F * (1 - f) * (1 - f)), after(0.5F * f * f), own(1 - before - after) {}
  float before, after, own;
};

class SmoothSampler {
 public:
  explicit SmoothSampler(const SmoothLevel& level) : level_(level) {}

  /// The sum of weighted values around pixel number `at`, and of their weights; (fu, fv) is how far
  /// the point lies beyond the pixel's tap origin. False if the level has no weight there.
  bool At(size_t at, float fu, float fv, RgbaVector* weighted, float* weight) const {
    const CellKind cell = level_.cells[at];
    if (cell == CellKind::kNone) {
      return false;
    }
    const Rgba* values = &level_.weighted[at];
    const bool full = cell == CellKind::kFull;
    if (level_.basis == Basis::kBilinear) {
      *weighted = Bilinear(values, values + level_.stride, fu, fv);
      *weight = full ? 1 : BilinearWeight(at, fu, fv);
      return true;
    }
    const SplineWeights u(fu);
    const SplineWeights v(fv);
    const auto line = [&u](const Rgba* middle) {
      return u.before * Load(middle[-1]) + u.own * Load(middle[0]) + u.after * Load(middle[1]);
    };
    *weighted = v.before * line(values - level_.stride) + v.own * line(values) +
                v.after * line(values + level_.stride);
    *weight = full ? 1 : SplineWeight(at, u, v);
    return true;
  }

 private:
  [[nodiscard]] float WeightAt(size_t pixel) const {
    return 0.5F * static_cast<float>(level_.halves[pixel]);
  }
  [[nodiscard]] float BilinearWeight(size_t at, float fu, float fv) const {
    const auto line = [&](size_t tap) {
      return WeightAt(tap) + fu * (WeightAt(tap + 1) - WeightAt(tap));
    };
    const float near = line(at);
    return near + fv * (line(at + static_cast<size_t>(level_.stride)) - near);
  }
  [[nodiscard]] float SplineWeight(size_t at, const SplineWeights& u,
                                   const SplineWeights& v) const {
    const auto stride = static_cast<size_t>(level_.stride);
    const auto line = [&](size_t tap) {
      return u.before * WeightAt(tap - 1) + u.own * WeightAt(tap) + u.after * WeightAt(tap + 1);
    };
    return v.before * line(at - stride) + v.own * line(at) + v.after * line(at + stride);
  }

  const SmoothLevel& level_;
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SMOOTH_SAMPLE_H_
