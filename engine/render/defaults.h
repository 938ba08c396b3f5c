#ifndef ENGINE_RENDER_DEFAULTS_H_
#define ENGINE_RENDER_DEFAULTS_H_

#include <functional>
#include <span>

#include "engine/base/status.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/render/transfer_function.h"
#include "engine/volume/brick_grid.h"

/// What a frame shows when nobody said: chosen from a step's statistics and coarse level alone.
namespace fovea::render {

/// The middle of the densest region of a step, in voxels: the super-voxel of LLL_0, smoothed over
/// its neighbours, that is farthest from the background (the histogram's fullest bin); of those
/// whose middle `accepts` takes, if it takes any. The middle is that of what lies in the volume.
[[nodiscard]] StatusOr<Vec3> DefaultFovea(
    CoefficientSource& source, const FieldStats& stats,
    const std::function<bool(const Vec3&)>& accepts = [](const Vec3&) { return true; });

/// 40, or everything where the volume is no larger than that.
[[nodiscard]] double DefaultRate(const Hierarchy& hierarchy);

/// A transfer function over the series' value range: the background (the fullest bin of the
/// histograms) transparent, values far above it brighter and more opaque (far below it, where that
/// side is the longer one; on both sides around a background near 0), scaled to the volume's
/// size so that the picture is neither empty nor a solid block.
[[nodiscard]] TransferFunction DefaultTransferFunction(std::span<const FieldStats> steps,
                                                       const Hierarchy& hierarchy);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_DEFAULTS_H_
