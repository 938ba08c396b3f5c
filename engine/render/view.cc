#include "engine/render/view.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fovea::render {
namespace {

/// Sight, right and up' of a view, unit vectors in world axes.
struct Axes {
  Vec3 sight, right, up;
};

Axes AxesOf(const OrthographicView& view) {
  const double az = view.azimuth_deg * std::numbers::pi / 180;
  const double el = view.elevation_deg * std::numbers::pi / 180;
  Axes axes;
  axes.sight = {std::cos(el) * std::cos(az), std::cos(el) * std::sin(az), std::sin(el)};
  const Vec3 up = std::abs(view.elevation_deg) > 89.999 ? Vec3{0, 1, 0} : Vec3{0, 0, 1};
  const Vec3 right = Cross(axes.sight, up);
  axes.right = (1 / Length(right)) * right;
  axes.up = Cross(axes.right, axes.sight);
  return axes;
}

/// Direction components this small are rounding of an exact zero (sin 180 degrees is 1e-16).
double Cleaned(double slope) {
  return std::abs(slope) < 1e-12 ? 0.0 : slope;
}

}  // namespace

Status Validate(const OrthographicView& view) {
  if (!std::isfinite(view.azimuth_deg)) {
    return InvalidArgument("azimuth_deg must be a finite number of degrees");
  }
  if (!(view.elevation_deg >= -90 && view.elevation_deg <= 90)) {
    return InvalidArgument("elevation_deg {} is outside its range, -90 to 90", view.elevation_deg);
  }
  if (view.span_voxels && !(*view.span_voxels > 0 && std::isfinite(*view.span_voxels))) {
    return InvalidArgument("span_voxels {} must be a finite number above 0", *view.span_voxels);
  }
  if (view.center_voxels) {
    for (int axis = 0; axis < 3; ++axis) {
      if (!std::isfinite((*view.center_voxels)[axis])) {
        return InvalidArgument("center: its {} must be a finite number", "xyz"[axis]);
      }
    }
  }
  return absl::OkStatus();
}

OrthographicView Resolved(const OrthographicView& view, const Int3& dims,
                          const Matrix4& index_to_world) {
  OrthographicView resolved = view;
  const Vec3 size{static_cast<double>(dims.x), static_cast<double>(dims.y),
                  static_cast<double>(dims.z)};
  if (!resolved.center_voxels) {
    resolved.center_voxels = 0.5 * size;
  }
  if (!resolved.span_voxels) {
    double diagonal = 0;
    for (const Vec3& corner : {size, Vec3{-size.x, size.y, size.z}, Vec3{size.x, -size.y, size.z},
                               Vec3{size.x, size.y, -size.z}}) {
      diagonal = std::max(diagonal, Length(index_to_world.TransformDirection(corner)));
    }
    resolved.span_voxels = diagonal / index_to_world.SmallestSpacing();
  }
  return resolved;
}

ShearView FactorView(const OrthographicView& requested, const Int3& dims,
                     const Matrix4& index_to_world, int width_px, int height_px) {
  const OrthographicView view = Resolved(requested, dims, index_to_world);
  const Axes axes = AxesOf(view);
  const Matrix4 to_index = index_to_world.Inverse();
  const double spacing = index_to_world.SmallestSpacing();
  const Vec3 ray = to_index.TransformDirection(axes.sight);

  ShearView shear;
  shear.sight = axes.sight;
  for (int axis = 1; axis < 3; ++axis) {
    // Ties go to x, then y; a hair of rounding must not decide.
    if (std::abs(ray[axis]) > std::abs(ray[shear.axis_k]) * (1 + 1e-12)) {
      shear.axis_k = axis;
    }
  }
  shear.axis_u = shear.axis_k == 0 ? 1 : 0;
  shear.axis_v = shear.axis_k == 2 ? 1 : 2;
  shear.ascending = ray[shear.axis_k] > 0;
  shear.slope_u = Cleaned(ray[shear.axis_u] / ray[shear.axis_k]);
  shear.slope_v = Cleaned(ray[shear.axis_v] / ray[shear.axis_k]);
  shear.step_length = 1 / (std::abs(ray[shear.axis_k]) * spacing);

  const double pixel = *view.span_voxels / height_px * spacing;
  const Vec3 column_step = to_index.TransformDirection(pixel * axes.right);
  const Vec3 row_step = to_index.TransformDirection(-pixel * axes.up);
  const Vec3 first = *view.center_voxels + ((1 - width_px) / 2.0) * column_step +
                     ((1 - height_px) / 2.0) * row_step;
  const auto sheared = [&shear](const Vec3& p, int axis, double slope) {
    return p[axis] - slope * p[shear.axis_k];
  };
  int i = 0;
  for (const auto& [axis, slope] :
       {std::pair(shear.axis_u, shear.slope_u), std::pair(shear.axis_v, shear.slope_v)}) {
    shear.warp[i++] = sheared(column_step, axis, slope);
    shear.warp[i++] = sheared(row_step, axis, slope);
    shear.warp[i++] = sheared(first, axis, slope);
  }
  return shear;
}

std::array<double, 2> ProjectToPixel(const OrthographicView& requested, const Int3& dims,
                                     const Matrix4& index_to_world, int width_px, int height_px,
                                     const Vec3& point) {
  const OrthographicView view = Resolved(requested, dims, index_to_world);
  const Axes axes = AxesOf(view);
  const double pixel = *view.span_voxels / height_px * index_to_world.SmallestSpacing();
  const Vec3 offset = index_to_world.TransformDirection(point - *view.center_voxels);
  return {Dot(offset, axes.right) / pixel + width_px / 2.0,
          -Dot(offset, axes.up) / pixel + height_px / 2.0};
}

}  // namespace fovea::render
