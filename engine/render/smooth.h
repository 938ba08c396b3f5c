#ifndef ENGINE_RENDER_SMOOTH_H_
#define ENGINE_RENDER_SMOOTH_H_

#include <vector>

#include "engine/render/foveated_frame.h"

namespace fovea::render {

/// How much of what interpolation between some pixels sees is the level's own.
enum class CellKind : uint8_t { kNone, kMixed, kFull };

/// One level of the foveated image, ready to be interpolated: each pixel's value times its weight,
/// and the weight in halves. It is 1 inside, falls to 0 over two pixels towards the edge of what
/// the level has. A border of kBorder pixels holds what interpolation meets outside rect: nothing
/// (weight 0) towards a coarser level; beyond the volume, transparency with the weight of the
/// pixel next to it between pixels one voxel wide, as in the full-resolution picture, and the
/// pixel itself between wider ones.
struct SmoothLevel {
  static constexpr int64_t kBorder = 3;

  int64_t width = 1;
  Rect rect;
  Basis basis = Basis::kBilinear;
  int64_t stride = 0;             // of rows
  std::vector<Rgba> values;       // of rect only: leaves, and means of split pixels' children
  std::vector<uint8_t> presence;  // 1 where the level has the pixel
  std::vector<Rgba> weighted;
  std::vector<uint8_t> halves;  // the weight times 2
  /// kBilinear: of four pixels, this one and those after it in u, v and both. kBspline: of nine,
  /// this one in their middle.
  std::vector<CellKind> cells;

  /// Of a pixel of rect or its border.
  [[nodiscard]] size_t Index(int64_t u, int64_t v) const {
    return static_cast<size_t>((v - rect.v0 + kBorder) * stride + u - rect.u0 + kBorder);
  }
};

/// Space-variant smoothing, Yu et al., section 5: the foveated image rebuilt with a smooth basis
/// instead of Haar's boxes. At a point p the value is, from coarse to fine,
///   v_l(p) = (1 - w_l(p)) v_{l-1}(p) + (w a)_l(p),
/// w_l and (w a)_l the interpolants of level l in the basis; pixels one voxel wide always take the
/// bilinear one, full resolution's. Thick pixels are smoothed over their own width; where the
/// finest level has all taps the value is that level's alone.
void Smooth(const std::vector<FrameLevel>& frame, Basis basis, int threads,
            std::vector<SmoothLevel>* levels);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SMOOTH_H_
