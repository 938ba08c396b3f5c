#include "engine/render/combine.h"

#include <algorithm>
#include <cmath>

#include "engine/base/parallel.h"

namespace fovea::render {
namespace {

/// What a pixel has gathered, free of its thickness: optical depth and emission per unit of depth.
/// Neighbours were split at different slices, so colour and transmittance cannot be mixed as such.
struct Density {
  float tau = 0;
  float red = 0, green = 0, blue = 0;  // emission
};

Density DensityOf(const Pixel& pixel, float depth) {
  Density density;
  if (depth <= 0 || pixel.transmittance >= 1.0F) {
    return density;
  }
  density.tau = -std::log(std::max(pixel.transmittance, 1e-7F)) / depth;
  const float per_cover = density.tau / (1.0F - pixel.transmittance);
  density.red = pixel.red * per_cover;
  density.green = pixel.green * per_cover;
  density.blue = pixel.blue * per_cover;
  return density;
}

Pixel GatheredOver(const Density& density, float depth) {
  Pixel pixel;
  if (depth <= 0 || density.tau <= 0) {
    return pixel;
  }
  pixel.transmittance = ExpNegative(-density.tau * depth);
  const float cover_per_tau = (1.0F - pixel.transmittance) / density.tau;
  pixel.red = density.red * cover_per_tau;
  pixel.green = density.green * cover_per_tau;
  pixel.blue = density.blue * cover_per_tau;
  return pixel;
}

/// One of the two accumulators of a level, as its children see it.
class Inheritance {
 public:
  Inheritance(const Layer& layer, const Gathered& gathered, bool smooth, int threads)
      : layer_(layer), gathered_(gathered), smooth_(smooth) {
    if (!smooth) {
      return;
    }
    densities_.resize(gathered.depth.size());
    ParallelFor(0, static_cast<int64_t>(densities_.size()), 4096, threads,
                [&](int64_t first, int64_t last) {
                  for (int64_t i = first; i < last; ++i) {
                    if (layer.split[i] != 0) {
                      densities_[i] = DensityOf(gathered.At(i), gathered.depth[i]);
                    }
                  }
                });
  }

  /// What child (u, v) of the next level takes over. Its parent is split.
  [[nodiscard]] Pixel For(int64_t u, int64_t v) const {
    const size_t own = layer_.Index(u >> 1, v >> 1);
    if (!smooth_) {
      return gathered_.At(own);
    }
    const int64_t du = (u & 1) != 0 ? 1 : -1;
    const int64_t dv = (v & 1) != 0 ? 1 : -1;
    Density sum;
    float weights = 0;
    Add(u >> 1, v >> 1, 9, &sum, &weights);
    Add((u >> 1) + du, v >> 1, 3, &sum, &weights);
    Add(u >> 1, (v >> 1) + dv, 3, &sum, &weights);
    Add((u >> 1) + du, (v >> 1) + dv, 1, &sum, &weights);
    if (weights <= 0) {
      return {};
    }
    const float scale = 1 / weights;
    return GatheredOver({sum.tau * scale, sum.red * scale, sum.green * scale, sum.blue * scale},
                        gathered_.depth[own]);
  }

 private:
  void Add(int64_t u, int64_t v, float weight, Density* sum, float* weights) const {
    if (!layer_.IsSplit(u, v)) {
      return;
    }
    const size_t i = layer_.Index(u, v);
    if (gathered_.depth[i] <= 0) {
      return;
    }
    const Density& d = densities_[i];
    sum->tau += weight * d.tau;
    sum->red += weight * d.red;
    sum->green += weight * d.green;
    sum->blue += weight * d.blue;
    *weights += weight;
  }

  const Layer& layer_;
  const Gathered& gathered_;
  bool smooth_;
  std::vector<Density> densities_;
};

/// Composites what the children of `coarser`'s split pixels inherit onto `finer`.
void PassDown(const Layer& coarser, bool smooth, int threads, Layer* finer) {
  const Inheritance front(coarser, coarser.front, smooth, threads);
  const Inheritance back(coarser, coarser.back, smooth, threads);
  const Rect& rect = finer->plan.rect;
  ParallelFor(rect.v0, rect.v1, 8, threads, [&](int64_t first, int64_t last) {
    for (int64_t v = first; v < last; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        if (!coarser.IsSplit(u >> 1, v >> 1)) {
          continue;
        }
        const size_t own = finer->Index(u, v);
        const size_t parent = coarser.Index(u >> 1, v >> 1);
        finer->front.Set(own, Over(front.For(u, v), finer->front.At(own)));
        finer->back.Set(own, Over(finer->back.At(own), back.For(u, v)));
        finer->front.depth[own] += 2 * coarser.front.depth[parent];
        finer->back.depth[own] += 2 * coarser.back.depth[parent];
      }
    }
  });
}

Rgba Covered(const Pixel& pixel) {
  return {pixel.red, pixel.green, pixel.blue, 1.0F - pixel.transmittance};
}

/// A child whose ray leaves through a side of the volume does not speak for a pixel that has
/// others crossing from face to face: it would draw the volume's edge into the middle of the pixel.
Rgba MeanOfChildren(const PyramidLevel& finer, int64_t u, int64_t v) {
  const auto crosses = [&](int i) {
    return finer.plan.crossing.Contains(2 * u + (i & 1), 2 * v + (i >> 1));
  };
  const bool any = crosses(0) || crosses(1) || crosses(2) || crosses(3);
  Rgba sum;
  float count = 0;
  for (int i = 0; i < 4; ++i) {
    if (any && !crosses(i)) {
      continue;
    }
    const Rgba& child = finer.values[finer.Index(2 * u + (i & 1), 2 * v + (i >> 1))];
    sum.red += child.red;
    sum.green += child.green;
    sum.blue += child.blue;
    sum.alpha += child.alpha;
    ++count;
  }
  return {sum.red / count, sum.green / count, sum.blue / count, sum.alpha / count};
}

/// The level's values, once the next finer level has its own. `coarser` is null for level 0.
PyramidLevel Finish(Layer layer, const Layer* coarser, const PyramidLevel* finer, int threads) {
  const Rect rect = layer.plan.rect;
  PyramidLevel level;
  level.plan = std::move(layer.plan);
  level.values.resize(layer.split.size());
  level.present.resize(layer.split.size());
  ParallelFor(rect.v0, rect.v1, 8, threads, [&](int64_t first, int64_t last) {
    for (int64_t v = first; v < last; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        const size_t i = level.Index(u, v);
        level.present[i] = coarser == nullptr || coarser->IsSplit(u >> 1, v >> 1) ? 1 : 0;
        if (layer.split[i] != 0) {
          level.values[i] = MeanOfChildren(*finer, u, v);
        } else if (level.present[i] != 0) {
          level.values[i] = Covered(Over(layer.front.At(i), layer.back.At(i)));
        }
      }
    }
  });
  level.split = std::move(layer.split);
  return level;
}

}  // namespace

std::vector<PyramidLevel> Combine(std::vector<Layer> layers, bool smooth_splitting, int threads) {
  for (size_t l = 1; l < layers.size(); ++l) {
    PassDown(layers[l - 1], smooth_splitting, threads, &layers[l]);
  }
  std::vector<PyramidLevel> pyramid(layers.size());
  for (size_t l = layers.size(); l-- > 0;) {
    pyramid[l] = Finish(std::move(layers[l]), l > 0 ? &layers[l - 1] : nullptr,
                        l + 1 < pyramid.size() ? &pyramid[l + 1] : nullptr, threads);
  }
  return pyramid;
}

}  // namespace fovea::render
