#ifndef ENGINE_RENDER_FUSED_H_
#define ENGINE_RENDER_FUSED_H_

#include <cstdint>
#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/retained_set.h"
#include "engine/render/thick_ray.h"

namespace fovea::render {

/// What a fused frame cost besides tracing.
struct FusedStats {
  uint64_t samples = 0;
  double read_ms = 0;         // time in the sources
  double reconstruct_ms = 0;  // inverse transform
  double smooth_warp_ms = 0;  // RenderFused only
  double total_ms = 0;        // the whole frame; not of TraceFused
  uint64_t peak_bytes = 0;    // of slices and detail held at one time
};

/// Reconstruction and rendering at once (Yu et al., section 3.1, the combined phases): slices
/// across the principal axis are reconstructed a few at a time as the rays reach them, and
/// forgotten. The layers, in scratch->layers, are those of Reconstruct and TraceThickRays, bit for
/// bit where nothing is skipped as spent, and within settings.spent_transmittance otherwise. Memory
/// O(r0^2 log n): per level a few slices, and one layer of detail as thick as a store's chunks. For
/// playing a sequence; a view that changes over one step is better served by super-voxels that are
/// kept. `color`, if given, is the source of a second field. FAILED_PRECONDITION unless the wavelet
/// is Haar; errors of the sources.
[[nodiscard]] Status TraceFused(CoefficientSource& source, CoefficientSource* color,
                                const RetainedSet& retained, const ShearView& view,
                                const Matrix4& index_to_world, const RenderSettings& settings,
                                TraceScratch* scratch, FusedStats* stats);

/// A frame that way: RenderFrame(Reconstruct(source, retained)) in one, the work of one thread but
/// for its last step. Orthographic views only. `stats`: smooth_warp_ms stays 0.
[[nodiscard]] StatusOr<FoveatedFrame> RenderFusedFrame(CoefficientSource& source,
                                                       const RetainedSet& retained,
                                                       const Matrix4& index_to_world,
                                                       const RenderSettings& settings,
                                                       FusedStats* stats = nullptr,
                                                       CoefficientSource* color = nullptr);

/// A picture that way: RenderFoveated(Reconstruct(source, retained)) in one. The frame is one
/// thread's work but for its last steps: to play a sequence, render a step on each thread.
[[nodiscard]] StatusOr<Image> RenderFused(CoefficientSource& source, const RetainedSet& retained,
                                          const Matrix4& index_to_world,
                                          const RenderSettings& settings,
                                          FusedStats* stats = nullptr,
                                          CoefficientSource* color = nullptr);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_FUSED_H_
