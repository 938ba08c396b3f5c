#ifndef ENGINE_RENDER_WARP_H_
#define ENGINE_RENDER_WARP_H_

#include <vector>

#include "engine/render/combine.h"
#include "engine/render/image.h"
#include "engine/render/smooth.h"
#include "engine/render/view.h"

/// Sheared image to picture, the only step that visits every pixel of the picture. Bilinear on
/// premultiplied linear values. Pixel (U, V) of a level has its centre at (U + 1/2, V + 1/2) w.
namespace fovea::render {

/// The staircase: between pixels one voxel wide, each with the value of the leaf it lies in.
/// Pixels outside `sheet` (SheetRect) are transparent.
[[nodiscard]] Image WarpLeaves(const std::vector<PyramidLevel>& pyramid, const Rect& sheet,
                               const ShearView& view, int width_px, int height_px, int threads);

/// The smoothed foveated image (Smooth), evaluated at every pixel of the picture.
[[nodiscard]] Image WarpSmooth(const std::vector<SmoothLevel>& levels, const Rect& sheet,
                               const ShearView& view, int width_px, int height_px, int threads);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_WARP_H_
