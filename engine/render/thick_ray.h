#ifndef ENGINE_RENDER_THICK_RAY_H_
#define ENGINE_RENDER_THICK_RAY_H_

#include <cstdint>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/render/composite.h"
#include "engine/render/renderer.h"
#include "engine/render/sheared_slices.h"
#include "engine/render/view.h"

namespace fovea::render {

/// What rays have gathered, a plane for each channel, row by row over the level's rectangle.
struct Gathered {
  std::vector<float> red, green, blue, transmittance;
  /// The depth composited, in the level's slices.
  std::vector<float> depth;

  [[nodiscard]] Pixel At(size_t i) const { return {red[i], green[i], blue[i], transmittance[i]}; }
  void Set(size_t i, const Pixel& pixel) {
    red[i] = pixel.red;
    green[i] = pixel.green;
    blue[i] = pixel.blue;
    transmittance[i] = pixel.transmittance;
  }
  /// `pixels` pixels that have met nothing.
  void Clear(size_t pixels);
};

/// One level of the intermediate image. Arrays are row by row over plan.rect.
struct Layer {
  LevelPlan plan;
  /// Front F and back K of every pixel: what this level drew before and behind what its window's
  /// children draw. After Combine they hold all that lies before and behind, coarser levels too.
  Gathered front, back;
  /// Whether the next level draws part of this pixel's ray: it has four children there.
  std::vector<uint8_t> split;
  /// In perspective, the path of every pixel's ray through a slice, in the picture's common path;
  /// else empty. Combined values hold for the common path.
  std::vector<float> path;

  [[nodiscard]] size_t Index(int64_t u, int64_t v) const {
    return static_cast<size_t>((v - plan.rect.v0) * plan.rect.Width() + u - plan.rect.u0);
  }
  [[nodiscard]] bool IsSplit(int64_t u, int64_t v) const {
    return plan.rect.Contains(u, v) && split[Index(u, v)] != 0;
  }
};

/// Traces the thick rays of every level through the super-voxels it owns. Yu et al., section 3.1;
/// `over` being associative, F and K stand for the forward and backward traces and need no line
/// where they meet. `color`, if given, is a second field over the same retained set: its values
/// give the colour. `samples`, if given, counts the samples met, skipped ones too.
[[nodiscard]] std::vector<Layer> TraceThickRays(const SuperVoxels& volume, const SuperVoxels* color,
                                                const ShearView& view,
                                                const Matrix4& index_to_world,
                                                const RenderSettings& settings, uint64_t* samples);

/// Buffers that keep their capacity from frame to frame.
struct TraceScratch {
  std::vector<Layer> layers;
  std::vector<std::vector<float>> reach;  // by level: what arrives of each ray
  std::vector<std::vector<float>> left;   // by level: what is left of it
  /// By level: the values turned for views along x, and the second field's.
  std::vector<std::vector<float>> turned, color_turned;
};

/// The same into scratch->layers; returns the samples met.
uint64_t TraceThickRays(const SuperVoxels& volume, const SuperVoxels* color, const ShearView& view,
                        const Matrix4& index_to_world, const RenderSettings& settings,
                        TraceScratch* scratch);

/// The weighting and clipping along row v of slice k, pixels and slices `width` voxels wide.
/// `thickness` is the slab's, in slices: 1, or less at the far border.
[[nodiscard]] WeightedRow MakeWeightedRow(const ShearView& view, const Matrix4& index_to_world,
                                          const Vec3& fovea, const RenderSettings& settings,
                                          int64_t v, int64_t k, double width, double thickness);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_THICK_RAY_H_
