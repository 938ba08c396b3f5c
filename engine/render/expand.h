#ifndef ENGINE_RENDER_EXPAND_H_
#define ENGINE_RENDER_EXPAND_H_

#include <vector>

#include "engine/render/foveated_frame.h"
#include "engine/render/image.h"
#include "engine/render/smooth.h"

namespace fovea::render {

/// Buffers of Expand, to be reused: with the same sizes as before nothing is allocated.
struct ExpandScratch {
  std::vector<SmoothLevel> levels;
};

/// The picture of a frame: smoothed by pixel size (kImage, kFull) or as it is (kNone), and warped.
/// `frame` must be valid, width_px and height_px 1 to kMaxPicturePixels; a size other than the
/// frame's own shows the same view at another resolution. The bits depend on frame, sizes and
/// smoothing only: not on threads, and not on where the frame came from.
void Expand(const FoveatedFrame& frame, int width_px, int height_px, Smoothing smoothing,
            Basis basis, int threads, ExpandScratch* scratch, Image* image);
[[nodiscard]] Image Expand(const FoveatedFrame& frame, int width_px, int height_px,
                           Smoothing smoothing, Basis basis, int threads);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_EXPAND_H_
