#ifndef SERVICE_FRAMES_MARKER_H_
#define SERVICE_FRAMES_MARKER_H_

#include "engine/render/image.h"

namespace fovea::frames {

/// Draws the paper's red dot over the picture: an antialiased disc with a thin dark rim, its
/// centre at (column, row) in pixels, its radius the larger of 3 pixels and 0.8 % of the height.
/// What falls outside the picture is clipped.
void DrawFoveaMarker(render::Image* image, double column, double row);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_MARKER_H_
