#ifndef ENGINE_RENDER_PERSPECTIVE_WARP_H_
#define ENGINE_RENDER_PERSPECTIVE_WARP_H_

#include <array>
#include <optional>
#include <vector>

#include "engine/render/foveated_frame.h"
#include "engine/render/image.h"
#include "engine/render/perspective_view.h"
#include "engine/render/smooth.h"

/// The images of the faces to a picture.
namespace fovea::render {

/// One face's image, ready to be looked up anywhere. Immutable; share it freely.
class FaceImage {
 public:
  /// The staircase: pixels outside `sheet` (FaceRect) are transparent.
  FaceImage(const PerspectiveFace& face, const Rect& sheet, std::vector<FrameLevel> levels);
  /// Smoothed.
  FaceImage(const PerspectiveFace& face, const Rect& sheet, std::vector<SmoothLevel> levels);

  /// The picture's value for a ray (voxel coordinates) of this face. Bilinear on premultiplied
  /// linear values; these hold for the face's common path (Layer::path), and what is found is
  /// lengthened to the ray's own, or thick pixels would show as steps in the thinnest fog.
  [[nodiscard]] Rgba Along(const Vec3& ray) const;

 private:
  [[nodiscard]] Rgba Leaf(int64_t u, int64_t v) const;
  [[nodiscard]] Rgba Staircase(double at_u, double at_v) const;
  [[nodiscard]] Rgba Smoothed(double at_u, double at_v) const;

  PerspectiveFace face_;
  Rect sheet_;
  std::vector<FrameLevel> leaves_;
  std::vector<SmoothLevel> smooth_;
};

/// The picture: every pixel asks the face of its ray.
[[nodiscard]] Image WarpFaces(const Pinhole& pinhole,
                              const std::array<std::optional<FaceImage>, 6>& faces, int threads);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PERSPECTIVE_WARP_H_
