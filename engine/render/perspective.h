#ifndef ENGINE_RENDER_PERSPECTIVE_H_
#define ENGINE_RENDER_PERSPECTIVE_H_

#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/foveated_frame.h"
#include "engine/render/image.h"
#include "engine/render/perspective_view.h"
#include "engine/render/renderer.h"

/// Perspective pictures: what RenderFoveated and RenderReference do when settings.perspective is
/// set. The other settings must be valid. INVALID_ARGUMENT for a view that is not, and for what
/// perspective does not do. ALGORITHM: rendering with thick rays, perspective.
namespace fovea::render {

/// One face's pyramid. Of `face`, expanding needs the axes, the eye, the reference plane, the world
/// steps and the common path.
struct FaceFrame {
  PerspectiveFace face;
  Rect sheet;
  std::vector<FrameLevel> levels;
};

/// What a FoveatedFrame is for an orthographic view: the frame before it is a picture. Faces in the
/// order of FaceOf.
struct PerspectiveFrame {
  Pinhole pinhole;
  std::vector<FaceFrame> faces;
};

/// INVALID_ARGUMENT, saying what, unless the frame is one that ExpandPerspective can draw. For
/// frames that came from elsewhere.
[[nodiscard]] Status Validate(const PerspectiveFrame& frame);

/// The frame alone. ExpandPerspective of it is RenderPerspective's picture, bit by bit.
[[nodiscard]] StatusOr<PerspectiveFrame> RenderPerspectiveFrame(const SuperVoxels& volume,
                                                                const SuperVoxels* color_volume,
                                                                const Matrix4& index_to_world,
                                                                const RenderSettings& settings,
                                                                RenderStats* stats);

/// The picture of a valid frame. Depends on frame and smoothing only.
[[nodiscard]] Image ExpandPerspective(PerspectiveFrame frame, Smoothing smoothing, Basis basis,
                                      int threads);

/// O(m + n^2) while the eye is outside the innermost box, else O(r0 n^2) more.
[[nodiscard]] StatusOr<Image> RenderPerspective(const SuperVoxels& volume,
                                                const SuperVoxels* color_volume,
                                                const Matrix4& index_to_world,
                                                const RenderSettings& settings, RenderStats* stats);

/// Loops over every voxel slice beyond the eye, on the same faces and with the same warp. `fovea`
/// places the reference planes.
[[nodiscard]] StatusOr<Image> ReferencePerspective(const Grid& voxels, const Grid* color_voxels,
                                                   const Matrix4& index_to_world, const Vec3& fovea,
                                                   const RenderSettings& settings,
                                                   RenderStats* stats);

/// Pixels of all levels of all faces of a valid view's frame.
[[nodiscard]] int64_t PerspectivePixels(const RetainedSet& retained, const PerspectiveView& view,
                                        const Matrix4& index_to_world, int width_px, int height_px);

/// About the bytes that RenderPerspective allocates for a valid view, the picture excepted: with
/// the eye near the fovea they grow with the square of the volume's size.
[[nodiscard]] double PerspectiveBytes(const RetainedSet& retained, const PerspectiveView& view,
                                      const Matrix4& index_to_world, int width_px, int height_px);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PERSPECTIVE_H_
