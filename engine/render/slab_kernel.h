#ifndef ENGINE_RENDER_SLAB_KERNEL_H_
#define ENGINE_RENDER_SLAB_KERNEL_H_

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/render/slab_cover.h"
#include "engine/render/transfer_function.h"

/// Where the time of a frame goes: a row of samples interpolated, classified and composited, with
/// SIMD (Highway, the instruction set chosen at run time). The same bits from AVX2 and AVX-512;
/// sets without fused multiply-add differ by rounding.
namespace fovea::render {

/// The transfer function as the kernel evaluates it. Up to kMostRamps points it is evaluated
/// exactly, as base + the sum of slope * clamp(value - start, 0, length) over its segments, in
/// registers; with more, by linear interpolation in a TransferTable.
struct KernelFunction {
  static constexpr int kMostRamps = 24;
  struct Ramp {
    float start, length;
    float slope[4];  // red, green, blue, opacity
  };
  explicit KernelFunction(const TransferFunction& transfer, bool by_table = false);
  [[nodiscard]] static bool NeedsTable(const TransferFunction& transfer) {
    return transfer.points.size() > kMostRamps + 1;
  }

  float base[4];
  std::vector<Ramp> ramps;
  std::optional<TransferTable> table;  // if there are more points than ramps may be
};

/// A light for gradient shading, all in the axes (u, v, k) of the slices.
struct KernelLight {
  float gradient_to_world[9];  // rows: world x, y, z of a gradient per super-voxel
  float to_light[3];           // unit vector, world
  float halfway[3];            // unit vector between the light and the viewer, world
  float ambient, diffuse, specular;
  int shininess_log2;   // the specular exponent is 2 to this power
  float weak_gradient;  // squared length below which a gradient says little
};

/// What all runs of a slice share. The taps of a pixel are four values: t, t + 1 and the same one
/// row on; gradients also read one row and one slice around, and one value to each side.
struct Slab {
  const float* taps = nullptr;
  const float* color_taps = nullptr;  // a second field whose value gives the colour; may be null
  int64_t row_stride = 0, slice_stride = 0;
  float fu = 0, fv = 0;                  // weights of the second taps
  float length = 0;                      // path through the slab in voxel lengths
  const SlabCover* cover = nullptr;      // for that length and the function's opacities, or null
  const float* opacity_scale = nullptr;  // D by pixel, or null for 1
  const float* length_scale = nullptr;   // the part of the path that counts, or null for all
  float* red = nullptr;                  // the accumulators
  float* green = nullptr;
  float* blue = nullptr;
  float* transmittance = nullptr;
};

/// A run of `count` pixels of one row: its first pixel is planes[pixel], its first tap taps[tap].
struct SlabRun {
  int64_t tap = 0, pixel = 0, count = 0;
};

/// Composites behind what the accumulators hold: Yu et al., eq. (3), slabs of opacity
/// 1 - (1 - D alpha)^length. `color` classifies color_taps, by a table if `function` does; with
/// those null it is not used.
void CompositeSlab(const KernelFunction& function, const KernelFunction& color,
                   const KernelLight* light, const Slab& slab, std::span<const SlabRun> runs);

/// Maximum intensity: slab.red keeps the largest value met, where any of the path
/// counts; the other accumulators are not used.
void MaximumSlab(const Slab& slab, std::span<const SlabRun> runs);

/// The instruction set in use, as Highway names it: "AVX3", "AVX2", "SSE4" ...
[[nodiscard]] std::string KernelTarget();

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SLAB_KERNEL_H_
