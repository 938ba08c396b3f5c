#ifndef ENGINE_RENDER_FOVEATED_FRAME_H_
#define ENGINE_RENDER_FOVEATED_FRAME_H_

#include <array>
#include <cstdint>
#include <vector>

#include "engine/base/status.h"
#include "engine/render/image.h"
#include "engine/render/sheared_slices.h"

/// A rendered frame before it is a picture: an image pyramid with detail only where the fovea's
/// windows are, O(r0^2 log n) pixels whatever the volume's and the picture's sizes. Yu et al.,
/// section 5. A plain value: it can be kept, copied or sent, and expanded elsewhere.
namespace fovea::render {

/// kNone: the paper's staircase. kImage: its section 5, space-variant smoothing of the picture.
/// kFull: thick rays are also split smoothly, so that the foreground of the fovea has no blocks.
enum class Smoothing { kNone, kImage, kFull };

/// What the smoothed picture is interpolated with: straight lines between pixel centres, or
/// quadratic B-splines, which have no creases.
enum class Basis { kBilinear, kBspline };

/// A pixel of one level: not drawn at this level, drawn, or drawn by its four children.
enum class PixelKind : uint8_t { kAbsent, kLeaf, kSplit };

/// One level of the pyramid. Arrays are row by row over rect.
struct FrameLevel {
  int64_t width = 1;  // voxels a pixel is wide: a power of two
  Rect rect;
  /// Sides of rect beyond which there is no volume (else: a coarser level's pixels).
  bool void_u0 = true, void_u1 = true, void_v0 = true, void_v1 = true;
  /// Pixels whose ray enters the volume's near face and leaves its far face.
  Rect crossing;
  std::vector<PixelKind> kinds;
  std::vector<Rgba> values;  // read at leaf pixels only

  [[nodiscard]] size_t Index(int64_t u, int64_t v) const {
    return static_cast<size_t>((v - rect.v0) * rect.Width() + u - rect.u0);
  }
};

inline constexpr size_t kMostFrameLevels = 16;  // a volume has at most 2^16 voxels an axis

/// The whole frame. Pixel (U, V) of a level has its centre at (U + 1/2, V + 1/2) width in sheared
/// coordinates (ShearView).
struct FoveatedFrame {
  /// Coarsest first, each half as wide as the one before. The children of a split pixel lie in the
  /// next level's rect; a pixel is present exactly where its parent is split, on level 0
  /// everywhere.
  std::vector<FrameLevel> levels;
  Rect sheet;  // voxel-wide pixels that can meet the volume: the picture is transparent beyond
  /// Picture to sheared coordinates, as ShearView::warp, for a picture of this size.
  std::array<double, 6> warp{};
  int width_px = 0, height_px = 0;
};

/// INVALID_ARGUMENT, saying what and at which level, unless the frame is one that Expand can draw.
/// For frames that came from elsewhere.
[[nodiscard]] Status Validate(const FoveatedFrame& frame);
/// The same for a pyramid and its sheet alone.
[[nodiscard]] Status Validate(const std::vector<FrameLevel>& levels, const Rect& sheet);

/// Where the pixels of another picture of the same view lie: height_px keeps the span of the
/// frame's view, and the centre stays. Equals frame.warp for the frame's own size.
[[nodiscard]] std::array<double, 6> WarpForSize(const FoveatedFrame& frame, int width_px,
                                                int height_px);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_FOVEATED_FRAME_H_
