#ifndef ENGINE_RENDER_PLAN_H_
#define ENGINE_RENDER_PLAN_H_

#include <cstdint>

#include "engine/fovea/retained_set.h"
#include "engine/render/view.h"
#include "engine/volume/geometry.h"

/// What a frame costs, before anything of it is read or drawn.
namespace fovea::render {

/// Counts that follow from windows and view alone.
struct FrameCounts {
  int64_t super_voxels = 0;        // RetainedSet::SuperVoxelCount
  int64_t samples = 0;             // RenderStats::samples, exactly
  int64_t accumulator_pixels = 0;  // of all levels' intermediate images
  int64_t picture_pixels = 0;
  /// Upper bound of what Reconstruct and RenderFoveated allocate together, the picture included,
  /// encoders not.
  int64_t memory_bytes = 0;
};

/// `view`: FactorView of the frame's view and size. Time and memory follow the slices of the
/// levels, whose number is below 2 n + 32. Thread-safe.
[[nodiscard]] FrameCounts CountFrame(const RetainedSet& retained, const ShearView& view,
                                     int width_px, int height_px);

/// Milliseconds by phase, as in RenderStats and ReconstructStats.
struct FrameTime {
  double read_ms = 0;
  double reconstruct_ms = 0;
  double render_ms = 0;
  double smooth_warp_ms = 0;
  [[nodiscard]] double Total() const {
    return read_ms + reconstruct_ms + render_ms + smooth_warp_ms;
  }
};

/// How long a frame takes on one thread, linear in its counts. The defaults are what plan_bench
/// fitted on the machine of docs/performance.md, chunks in the page cache, smoothing `full`; a
/// transfer function that leaves much of the volume transparent, or hides it, makes frames faster.
struct CostModel {
  double us_per_chunk = 51.0;
  double ns_per_byte = 5.0;
  double ns_per_super_voxel = 4.4;
  double ns_per_sample = 2.3;
  double ns_per_accumulator_pixel = 92.0;
  double ns_per_picture_pixel = 12.7;
  double ns_per_smoothed_pixel = 36.0;  // of the accumulators
  /// What a second, third ... thread adds, in threads.
  double gain_per_thread = 0.7;
};

/// `chunks` and `bytes`: what is read for the frame. `threads`: at least 1.
[[nodiscard]] FrameTime PredictTime(const FrameCounts& counts, uint64_t chunks, uint64_t bytes,
                                    int threads, const CostModel& model = {});

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PLAN_H_
