#ifndef ENGINE_RENDER_VIEW_H_
#define ENGINE_RENDER_VIEW_H_

#include <array>
#include <optional>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"

namespace fovea::render {

/// An orthographic view. The direction of sight is d = (cos el cos az, cos el sin az, sin el) in
/// world axes; up is +z (+y when |el| > 89.999), right = d x up, up' = right x d. Pixel (i, j) of
/// a W x H picture, row 0 on top, is the ray through
/// centre + ((i + 1/2 - W/2) right - (j + 1/2 - H/2) up') * span/H, in units of the smallest
/// voxel spacing.
struct OrthographicView {
  double azimuth_deg = 0;             // any finite
  double elevation_deg = 0;           // -90 to 90
  std::optional<Vec3> center_voxels;  // default: the middle of the volume
  std::optional<double> span_voxels;  // over the picture's height, above 0; default: it fits
  friend bool operator==(const OrthographicView&, const OrthographicView&) = default;
};

/// INVALID_ARGUMENT naming the value and its range.
[[nodiscard]] Status Validate(const OrthographicView& view);

/// The view's default centre and span for a volume, filled in: the middle, and the diagonal.
[[nodiscard]] OrthographicView Resolved(const OrthographicView& view, const Int3& dims,
                                        const Matrix4& index_to_world);

/// The view factored into shear and warp (Lacroute and Levoy, in the volume's index space). The
/// principal axis k is the one along which the direction of sight is longest; u and v are the
/// other two in order. A ray keeps its sheared coordinates U = u - slope_u z, V = v - slope_v z
/// (z: position on axis k), all in voxels.
struct ShearView {
  int axis_k = 0, axis_u = 1, axis_v = 2;
  bool ascending = true;            // whether sight goes towards larger z
  double slope_u = 0, slope_v = 0;  // du/dz, dv/dz; both within [-1, 1]
  double step_length = 1;           // path length of a ray per slice, in smallest spacings
  /// Picture to sheared coordinates: U = m[0] i + m[1] j + m[2], V = m[3] i + m[4] j + m[5], with
  /// i, j counted from pixel centres (0 is the centre of the first pixel).
  std::array<double, 6> warp{};
  Vec3 sight;  // d, world axes
};

/// `view` must be valid; `width_px`, `height_px` at least 1; the matrix invertible.
[[nodiscard]] ShearView FactorView(const OrthographicView& view, const Int3& dims,
                                   const Matrix4& index_to_world, int width_px, int height_px);

/// Where a point of the volume (voxel coordinates) appears in the picture: column, row in pixels,
/// (0, 0) the upper left corner of the first pixel.
[[nodiscard]] std::array<double, 2> ProjectToPixel(const OrthographicView& view, const Int3& dims,
                                                   const Matrix4& index_to_world, int width_px,
                                                   int height_px, const Vec3& point);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_VIEW_H_
