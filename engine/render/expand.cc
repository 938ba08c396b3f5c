#include "engine/render/expand.h"

#include "engine/render/warp.h"

namespace fovea::render {

void Expand(const FoveatedFrame& frame, int width_px, int height_px, Smoothing smoothing,
            Basis basis, int threads, ExpandScratch* scratch, Image* image) {
  image->width = width_px;
  image->height = height_px;
  image->rgba.resize(4 * static_cast<size_t>(width_px) * static_cast<size_t>(height_px));
  const std::array<double, 6> warp = WarpForSize(frame, width_px, height_px);
  if (smoothing == Smoothing::kNone) {
    WarpLeaves(frame.levels, frame.sheet, warp, threads, image);
    return;
  }
  Smooth(frame.levels, basis, threads, &scratch->levels);
  WarpSmooth(scratch->levels, frame.sheet, warp, threads, image);
}

Image Expand(const FoveatedFrame& frame, int width_px, int height_px, Smoothing smoothing,
             Basis basis, int threads) {
  ExpandScratch scratch;
  Image image;
  Expand(frame, width_px, height_px, smoothing, basis, threads, &scratch, &image);
  return image;
}

}  // namespace fovea::render
