#ifndef ENGINE_RENDER_COMBINE_KERNELS_H_
#define ENGINE_RENDER_COMBINE_KERNELS_H_

#include <cstddef>
#include <cstdint>

#include "engine/render/foveated_frame.h"

/// The arithmetic of Combine on runs of pixels in one row, a plane for each channel. Dispatched to
/// the best instruction set; AVX2 and AVX-512 give the same bits. Rows may have any alignment.
namespace fovea::render {

/// Accumulators F or K of a run.
struct GatheredRun {
  float *red, *green, *blue, *transmittance, *depth;
};

/// What split pixels have gathered, free of its thickness: optical depth tau and emission per unit
/// of depth. Neighbours were split at different slices, so colour and transmittance cannot be
/// mixed as such. `share` is 1 where the pixel takes part, and all is 0 elsewhere. Each plane has
/// one element before the run that is 0, and is writable, and 0, up to kDensitySlack after it.
struct DensityRun {
  float *tau, *red, *green, *blue, *share;
};
inline constexpr size_t kDensitySlack = 32;

/// What children take over: transmittance 1 and the rest 0 where the parent is not split.
/// Each plane is kChildBlock long.
inline constexpr size_t kParentBlock = 128;
inline constexpr size_t kChildBlock = 2 * kParentBlock + 64;
struct Inheritance {
  alignas(64) float red[kChildBlock];
  alignas(64) float green[kChildBlock];
  alignas(64) float blue[kChildBlock];
  alignas(64) float transmittance[kChildBlock];
  alignas(64) float depth[kChildBlock];  // the parent's N
};

/// Densities of `count` pixels. `split` is 1 or 0.
void FindDensities(const GatheredRun& from, const uint8_t* split, size_t count,
                   const DensityRun& to);

/// What the 2 `count` children of a run of parents inherit, in one row of children: `near` are
/// their parents' densities, `far` those of the row of parents they lie towards.
void InheritSmoothly(const DensityRun& near, const DensityRun& far, const float* parent_depth,
                     const uint8_t* split, size_t count, Inheritance* to);
/// The same by copying the parent's own. `count` is at most kParentBlock.
void InheritCopies(const GatheredRun& parents, const uint8_t* split, size_t count, Inheritance* to);

/// own = inherited over own, for F; own = own over inherited, for K. Depths add, the inherited in
/// slices twice as thick.
void CompositeBefore(const Inheritance& inherited, size_t count, const GatheredRun& own);
void CompositeBehind(const Inheritance& inherited, size_t count, const GatheredRun& own);

/// F over K as colour and cover where `kinds` says leaf, and zeros elsewhere.
void ShowLeaves(const GatheredRun& front, const GatheredRun& back, const PixelKind* kinds,
                size_t count, Rgba* values);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_COMBINE_KERNELS_H_
