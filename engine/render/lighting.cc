#include "engine/render/lighting.h"

#include <algorithm>

namespace fovea::render {

KernelLight MakeLight(const Lighting& lighting, const TransferFunction& transfer,
                      const ShearView& view, const Matrix4& index_to_world) {
  constexpr double kSurfacesFrom = 1.0 / 50;
  KernelLight light;
  // A gradient is a covector: it goes to the world by the inverse transposed.
  const Matrix4 to_index = index_to_world.Inverse();
  const double scale = index_to_world.SmallestSpacing();
  const int axes[3] = {view.axis_u, view.axis_v, view.axis_k};
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      Vec3 world;
      world[row] = 1;
      light.gradient_to_world[3 * row + column] =
          static_cast<float>(scale * to_index.TransformDirection(world)[axes[column]]);
    }
  }
  const Vec3 to_viewer = -1.0 * view.sight;
  Vec3 to_light = lighting.to_light;
  to_light = Length(to_light) > 0 ? (1 / Length(to_light)) * to_light : to_viewer;
  Vec3 halfway = to_light + to_viewer;
  // A light straight ahead has no halfway direction; nothing shines there.
  halfway = Length(halfway) > 1e-9 ? (1 / Length(halfway)) * halfway : Vec3{};
  for (int axis = 0; axis < 3; ++axis) {
    light.to_light[axis] = static_cast<float>(to_light[axis]);
    light.halfway[axis] = static_cast<float>(halfway[axis]);
  }
  light.ambient = lighting.ambient;
  light.diffuse = lighting.diffuse;
  light.specular = lighting.specular;
  light.shininess_log2 = 0;
  while ((1 << light.shininess_log2) < lighting.shininess) {
    ++light.shininess_log2;
  }
  const double range = transfer.points.back().value - transfer.points.front().value;
  const double weak = kSurfacesFrom * std::max(range, 1e-30);
  light.weak_gradient = std::max(static_cast<float>(weak * weak), 1e-30F);
  return light;
}

}  // namespace fovea::render
