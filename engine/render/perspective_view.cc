#include "engine/render/perspective_view.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fovea::render {
namespace {

struct Axes {
  Vec3 sight, right, up;
};

Vec3 Unit(const Vec3& a) {
  return (1 / Length(a)) * a;
}

Vec3 SightOf(const PerspectiveView& view, const Matrix4& index_to_world) {
  return Unit(index_to_world.TransformDirection(view.target_voxels - view.eye_voxels));
}

Axes AxesOf(const PerspectiveView& view, const Matrix4& index_to_world) {
  Axes axes;
  axes.sight = SightOf(view, index_to_world);
  axes.right = Unit(Cross(axes.sight, Unit(UpOf(view, index_to_world))));
  axes.up = Cross(axes.right, axes.sight);
  return axes;
}

/// How far apart pixels are at distance 1.
double PixelStep(const PerspectiveView& view, int height_px) {
  return 2 * std::tan(view.fov_y_deg * std::numbers::pi / 360) / height_px;
}

Status CheckPlace(const char* name, const Vec3& place) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(std::abs(place[axis]) <= kMostEyeVoxels)) {
      return InvalidArgument("{} {}, {}, {}: its {} is outside its range, {} to {} voxels", name,
                             place.x, place.y, place.z, "xyz"[axis], -kMostEyeVoxels,
                             kMostEyeVoxels);
    }
  }
  return absl::OkStatus();
}

}  // namespace

Vec3 UpOf(const PerspectiveView& view, const Matrix4& index_to_world) {
  constexpr double kSin = 1.745e-5;  // of 0.001 degrees, as orthographic views have it
  const Vec3 sight = SightOf(view, index_to_world);
  return view.up.value_or(std::hypot(sight.x, sight.y) < kSin ? Vec3{0, 1, 0} : Vec3{0, 0, 1});
}

Status Validate(const PerspectiveView& view, const Matrix4& index_to_world) {
  FOVEA_RETURN_IF_ERROR(CheckPlace("eye", view.eye_voxels));
  FOVEA_RETURN_IF_ERROR(CheckPlace("target", view.target_voxels));
  if (!(view.fov_y_deg >= kLeastFovDeg && view.fov_y_deg <= kMostFovDeg)) {
    return InvalidArgument("fov_y_deg {} is outside its range, {} to {}", view.fov_y_deg,
                           kLeastFovDeg, kMostFovDeg);
  }
  const Vec3& eye = view.eye_voxels;
  const double reach = std::max({1.0, std::abs(eye.x), std::abs(eye.y), std::abs(eye.z)});
  if (!(Length(view.target_voxels - eye) > 1e-9 * reach)) {
    return InvalidArgument("target {}, {}, {} is the eye itself: there is no direction of sight",
                           view.target_voxels.x, view.target_voxels.y, view.target_voxels.z);
  }
  if (!view.up) {
    return absl::OkStatus();
  }
  const Vec3& up = *view.up;
  if (!(std::isfinite(Length(up)) && Length(up) > 0)) {
    return InvalidArgument("up {}, {}, {} must be finite numbers, not all 0", up.x, up.y, up.z);
  }
  const Vec3 sight = SightOf(view, index_to_world);
  if (!(Length(Cross(sight, Unit(up))) > 1e-6)) {
    return InvalidArgument(
        "up {}, {}, {} is parallel to the direction of sight, {:.6g}, {:.6g}, {:.6g} in world axes",
        up.x, up.y, up.z, sight.x, sight.y, sight.z);
  }
  return absl::OkStatus();
}

Pinhole MakePinhole(const PerspectiveView& view, const Matrix4& index_to_world, int width_px,
                    int height_px) {
  const Axes axes = AxesOf(view, index_to_world);
  const Matrix4 to_index = index_to_world.Inverse();
  const double pixel = PixelStep(view, height_px);
  Pinhole pinhole;
  pinhole.eye = view.eye_voxels;
  pinhole.column_step = to_index.TransformDirection(pixel * axes.right);
  pinhole.row_step = to_index.TransformDirection(-pixel * axes.up);
  pinhole.first = to_index.TransformDirection(axes.sight) +
                  ((1 - width_px) / 2.0) * pinhole.column_step +
                  ((1 - height_px) / 2.0) * pinhole.row_step;
  pinhole.width_px = width_px;
  pinhole.height_px = height_px;
  return pinhole;
}

std::optional<std::array<double, 2>> ProjectToPixel(const PerspectiveView& view,
                                                    const Matrix4& index_to_world, int width_px,
                                                    int height_px, const Vec3& point) {
  const Axes axes = AxesOf(view, index_to_world);
  const Vec3 offset = index_to_world.TransformDirection(point - view.eye_voxels);
  const double before = Dot(offset, axes.sight);
  if (!(before > 0)) {
    return std::nullopt;
  }
  const double scale = 1 / (before * PixelStep(view, height_px));
  return std::array{scale * Dot(offset, axes.right) + width_px / 2.0,
                    -scale * Dot(offset, axes.up) + height_px / 2.0};
}

Vec3 PerspectiveFace::WayAt(double at_u, double at_v) const {
  const double reach = reference_z - eye[axis_k];
  const Vec3 way =
      world_k + ((at_u - eye[axis_u]) / reach) * world_u + ((at_v - eye[axis_v]) / reach) * world_v;
  return (ascending ? 1.0 : -1.0) * way;
}

namespace {

/// The part of a polygon of directions with normal . p >= 0 (Sutherland and Hodgman).
std::vector<Vec3> Clipped(const std::vector<Vec3>& polygon, const Vec3& normal) {
  std::vector<Vec3> kept;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const Vec3& a = polygon[i];
    const Vec3& b = polygon[(i + 1) % polygon.size()];
    const double at_a = Dot(normal, a);
    const double at_b = Dot(normal, b);
    if (at_a >= 0) {
      kept.push_back(a);
    }
    if ((at_a >= 0) != (at_b >= 0)) {
      kept.push_back(a + (at_a / (at_a - at_b)) * (b - a));
    }
  }
  return kept;
}

/// The directions of the picture that belong to a face: corners, or nothing.
std::vector<Vec3> PictureWithin(const Pinhole& pinhole, const PerspectiveFace& face) {
  const double right = pinhole.width_px - 0.5;
  const double bottom = pinhole.height_px - 0.5;
  std::vector<Vec3> polygon = {pinhole.Ray(-0.5, -0.5), pinhole.Ray(right, -0.5),
                               pinhole.Ray(right, bottom), pinhole.Ray(-0.5, bottom)};
  for (const int axis : {face.axis_u, face.axis_v}) {
    for (const double side : {-1.0, 1.0}) {
      Vec3 normal;
      normal[face.axis_k] = face.ascending ? 1 : -1;
      normal[axis] = side;
      polygon = Clipped(polygon, normal);
    }
  }
  return polygon;
}

/// Between the paths at the middle of what is seen and at its corners.
double CommonPath(const PerspectiveFace& face) {
  const auto path = [&face](double slope_u, double slope_v) {
    return Length(face.world_k + slope_u * face.world_u + slope_v * face.world_v);
  };
  const double middle =
      path((face.slope_u0 + face.slope_u1) / 2, (face.slope_v0 + face.slope_v1) / 2);
  const double longest =
      std::max({path(face.slope_u0, face.slope_v0), path(face.slope_u1, face.slope_v0),
                path(face.slope_u0, face.slope_v1), path(face.slope_u1, face.slope_v1)});
  return std::sqrt(middle * longest);
}

double ReferenceDistance(const PerspectiveFace& face, const Vec3& fovea) {
  const double depth = fovea[face.axis_k] - face.eye[face.axis_k];
  const double ahead = face.ascending ? depth : -depth;
  return ahead > 0 ? std::max(ahead, face.far / 2) : (face.near + face.far) / 2;
}

}  // namespace

std::array<std::optional<PerspectiveFace>, 6> MakeFaces(const Pinhole& pinhole,
                                                        const Matrix4& index_to_world,
                                                        const Int3& dims, const Vec3& fovea) {
  const double scale = 1 / index_to_world.SmallestSpacing();
  const auto step = [&](int axis) {
    Vec3 unit;
    unit[axis] = 1;
    return scale * index_to_world.TransformDirection(unit);
  };
  std::array<std::optional<PerspectiveFace>, 6> faces;
  for (int index = 0; index < 6; ++index) {
    PerspectiveFace face;
    face.axis_k = index / 2;
    face.axis_u = face.axis_k == 0 ? 1 : 0;
    face.axis_v = face.axis_k == 2 ? 1 : 2;
    face.ascending = index % 2 == 0;
    face.eye = pinhole.eye;
    const double eye_z = face.eye[face.axis_k];
    const auto depth = static_cast<double>(dims[face.axis_k]);
    face.near = std::max(0.0, face.ascending ? -eye_z : eye_z - depth);
    face.far = face.ascending ? depth - eye_z : eye_z;
    const std::vector<Vec3> seen = PictureWithin(pinhole, face);
    if (face.far <= 0 || seen.empty()) {
      continue;
    }
    const double reach = ReferenceDistance(face, fovea);
    face.reference_z = face.ascending ? eye_z + reach : eye_z - reach;
    face.slope_u0 = face.slope_v0 = 1;
    face.slope_u1 = face.slope_v1 = -1;
    for (const Vec3& ray : seen) {
      const double slope_u = std::clamp(ray[face.axis_u] / ray[face.axis_k], -1.0, 1.0);
      const double slope_v = std::clamp(ray[face.axis_v] / ray[face.axis_k], -1.0, 1.0);
      face.slope_u0 = std::min(face.slope_u0, slope_u);
      face.slope_u1 = std::max(face.slope_u1, slope_u);
      face.slope_v0 = std::min(face.slope_v0, slope_v);
      face.slope_v1 = std::max(face.slope_v1, slope_v);
    }
    face.world_u = step(face.axis_u);
    face.world_v = step(face.axis_v);
    face.world_k = step(face.axis_k);
    face.common_path = CommonPath(face);
    faces[index] = face;
  }
  return faces;
}

}  // namespace fovea::render
