#ifndef ENGINE_RENDER_PERSPECTIVE_VIEW_H_
#define ENGINE_RENDER_PERSPECTIVE_VIEW_H_

#include <array>
#include <optional>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"

namespace fovea::render {

inline constexpr double kLeastFovDeg = 0.01;
inline constexpr double kMostFovDeg = 170;
inline constexpr double kMostEyeVoxels = 1e9;

/// A camera at a point, outside or inside the volume. With d the unit direction from eye to target
/// in world axes, right = d x up and up' = right x d, pixel (i, j) of a W x H picture, row 0 on
/// top, is the ray from the eye along
/// d + ((i + 1/2 - W/2) right - (j + 1/2 - H/2) up') * 2 tan(fov/2)/H.
struct PerspectiveView {
  Vec3 eye_voxels;         // voxel coordinates; each within +-kMostEyeVoxels
  Vec3 target_voxels;      // what the picture's centre shows; not the eye; limits as the eye
  std::optional<Vec3> up;  // world axes, any length, not parallel to the direction of sight;
                           // default +z (+y when sight is within 0.001 degrees of z)
  double fov_y_deg = 45;   // of the picture's height, kLeastFovDeg to kMostFovDeg
  friend bool operator==(const PerspectiveView&, const PerspectiveView&) = default;
};

/// INVALID_ARGUMENT naming the value and its range.
[[nodiscard]] Status Validate(const PerspectiveView& view, const Matrix4& index_to_world);

/// The view's up, or its default. `view` must be valid but for `up`, which is taken as it is.
[[nodiscard]] Vec3 UpOf(const PerspectiveView& view, const Matrix4& index_to_world);

/// The camera in voxel coordinates, where it is a pinhole too (an affine map keeps straight lines).
/// Pixel (i, j) looks along first + i column_step + j row_step, of no particular length.
struct Pinhole {
  Vec3 eye;
  Vec3 first, column_step, row_step;
  int width_px = 1, height_px = 1;

  [[nodiscard]] Vec3 Ray(double column, double row) const {
    return first + column * column_step + row * row_step;
  }
};

/// `view` must be valid, the matrix invertible, the sizes at least 1.
[[nodiscard]] Pinhole MakePinhole(const PerspectiveView& view, const Matrix4& index_to_world,
                                  int width_px, int height_px);

/// Where a point (voxel coordinates) appears in the picture, (0, 0) the upper left corner of the
/// first pixel; nothing if it is not before the camera.
[[nodiscard]] std::optional<std::array<double, 2>> ProjectToPixel(const PerspectiveView& view,
                                                                  const Matrix4& index_to_world,
                                                                  int width_px, int height_px,
                                                                  const Vec3& point);

/// The rays whose largest direction component (in voxel coordinates) lies on axis k, one way: one
/// of six pyramids around the eye. Its sheared image stands on the plane z = reference_z: pixel
/// (U, V), in voxels, is the ray from the eye through that point. At depth z the ray is at
/// u = e_u + (U - e_u) Scale(z), likewise v.
struct PerspectiveFace {
  int axis_k = 0, axis_u = 1, axis_v = 2;
  bool ascending = true;     // whether sight goes towards larger z
  Vec3 eye;                  // voxel coordinates
  double reference_z = 0;    // not the eye's z; beyond it
  double near = 0, far = 0;  // where the volume begins and ends beyond the eye, 0 <= near < far
  double slope_u0 = 0, slope_u1 = 0;  // du/dz that the picture asks for, within [-1, 1]
  double slope_v0 = 0, slope_v1 = 0;
  double common_path = 1;          // about the length of WayAt for what the picture asks for
  Vec3 world_u, world_v, world_k;  // a voxel's step on each axis: world axes, smallest spacings

  /// How far from the eye depth z lies, in distances of the reference plane. Above 0 beyond it.
  [[nodiscard]] double Scale(double z) const {
    return (z - eye[axis_k]) / (reference_z - eye[axis_k]);
  }
  /// A ray's way per voxel of depth, away from the viewer: world axes, in smallest spacings. Its
  /// length is the path through one voxel slice.
  [[nodiscard]] Vec3 WayAt(double at_u, double at_v) const;
};

/// Index of the face that a ray (voxel coordinates) belongs to: 2 axis + (1 if it goes down). Ties
/// go to x, then y.
[[nodiscard]] inline int FaceOf(const Vec3& ray) {
  const double x = ray.x < 0 ? -ray.x : ray.x;
  const double y = ray.y < 0 ? -ray.y : ray.y;
  const double z = ray.z < 0 ? -ray.z : ray.z;
  const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  return 2 * axis + (ray[axis] < 0 ? 1 : 0);
}

/// The faces that the picture sees and that have volume beyond the eye, by FaceOf. Leaf pixels are
/// one voxel wide at the fovea's depth, or at the middle of the volume beyond the eye if the fovea
/// is behind it; but not nearer than half the way to the volume's far end, where a thick pixel is
/// then at most two super-voxels wide.
[[nodiscard]] std::array<std::optional<PerspectiveFace>, 6> MakeFaces(const Pinhole& pinhole,
                                                                      const Matrix4& index_to_world,
                                                                      const Int3& dims,
                                                                      const Vec3& fovea);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PERSPECTIVE_VIEW_H_
