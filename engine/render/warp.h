#ifndef ENGINE_RENDER_WARP_H_
#define ENGINE_RENDER_WARP_H_

#include <array>
#include <vector>

#include "engine/render/foveated_frame.h"
#include "engine/render/image.h"
#include "engine/render/smooth.h"

/// Sheared image to picture, the only step that visits every pixel of the picture. Bilinear on
/// premultiplied linear values. Pixel (U, V) of a level has its centre at (U + 1/2, V + 1/2) w.
/// `warp` is ShearView::warp; the image has its size, and is overwritten.
namespace fovea::render {

/// The staircase: between pixels one voxel wide, each with the value of the leaf it lies in.
/// Pixels outside `sheet` (SheetRect) are transparent.
void WarpLeaves(const std::vector<FrameLevel>& levels, const Rect& sheet,
                const std::array<double, 6>& warp, int threads, Image* image);

/// The smoothed foveated image (Smooth), evaluated at every pixel of the picture.
void WarpSmooth(const std::vector<SmoothLevel>& levels, const Rect& sheet,
                const std::array<double, 6>& warp, int threads, Image* image);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_WARP_H_
