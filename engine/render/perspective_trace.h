#ifndef ENGINE_RENDER_PERSPECTIVE_TRACE_H_
#define ENGINE_RENDER_PERSPECTIVE_TRACE_H_

#include <cstdint>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/render/live_blocks.h"
#include "engine/render/perspective_slices.h"
#include "engine/render/renderer.h"
#include "engine/render/slab_kernel.h"
#include "engine/render/thick_ray.h"
#include "engine/volume/grid.h"

namespace fovea::render {

/// What all levels of all faces share.
struct PerspectiveInputs {
  PerspectiveInputs(const RenderSettings& wanted, const Vec3& fovea_at)
      : settings(wanted),
        fovea(fovea_at),
        function(wanted.transfer),
        color(wanted.color_transfer.points.empty() ? wanted.transfer : wanted.color_transfer),
        transparent(wanted.transfer) {}

  const RenderSettings& settings;
  Vec3 fovea;
  KernelFunction function, color;  // color: of a second field, if there is one
  TransparentValues transparent;
};

/// Traces the rays of one level of a face through the slices it owns. `grid` holds that level's
/// super-voxels; reads beyond it repeat its border. `color`, if given, is a grid as large whose
/// values give the colour. With `blocks`, samples that show nothing are skipped. Adds the samples
/// met, skipped ones too, to `samples`.
[[nodiscard]] Layer TraceLevel(const PerspectiveInputs& frame, const Grid& grid, const Grid* color,
                               const ValueBlocks* blocks, const PerspectiveLevel& level,
                               const PerspectiveFace& face, uint64_t* samples);

/// Every level of a face, coarsest first. Yu et al., section 3.1, in perspective.
[[nodiscard]] std::vector<Layer> TraceThickRays(const PerspectiveInputs& frame,
                                                const SuperVoxels& volume, const SuperVoxels* color,
                                                const PerspectiveFace& face, uint64_t* samples);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PERSPECTIVE_TRACE_H_
