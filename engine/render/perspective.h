#ifndef ENGINE_RENDER_PERSPECTIVE_H_
#define ENGINE_RENDER_PERSPECTIVE_H_

#include "engine/base/status.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/image.h"
#include "engine/render/renderer.h"

/// Perspective pictures: what RenderFoveated and RenderReference do when settings.perspective is
/// set. The other settings must be valid. INVALID_ARGUMENT for a view that is not, and for what
/// perspective does not do. ALGORITHM: rendering with thick rays, perspective.
namespace fovea::render {

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

/// About the bytes that RenderPerspective allocates for a valid view, the picture excepted: with
/// the eye near the fovea they grow with the square of the volume's size.
[[nodiscard]] double PerspectiveBytes(const RetainedSet& retained, const PerspectiveView& view,
                                      const Matrix4& index_to_world, int width_px, int height_px);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PERSPECTIVE_H_
