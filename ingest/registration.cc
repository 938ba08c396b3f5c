#include "ingest/registration.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace fovea::ingest {
namespace {

constexpr double kMatrixTolerance = 1e-6;

std::string Show(const Vec3& v) {
  return fmt::format("({:.9g}, {:.9g}, {:.9g})", v.x, v.y, v.z);
}

int64_t ToIndex(double value) {
  constexpr double kLimit = 2147483647.0;
  return static_cast<int64_t>(std::clamp(value, -kLimit, kLimit));
}

bool IsNear(const Vec3& a, const Vec3& b) {
  return Length(a - b) < 1e-4;
}

}  // namespace

Matrix4 Moved(const Matrix4& a, const Vec3& offset) {
  Matrix4 result = a;
  const Vec3 origin = a.TransformPoint(offset);
  result.m[3] = origin.x;
  result.m[7] = origin.y;
  result.m[11] = origin.z;
  return result;
}

std::string Difference(const Matrix4& a, const Matrix4& b) {
  double scale = 0;
  double reach = 0;
  double linear = 0;
  double shift = 0;
  for (size_t i = 0; i < 12; ++i) {
    const double difference = std::abs(a.m[i] - b.m[i]);
    if (i % 4 == 3) {
      reach = std::max(reach, std::abs(a.m[i]));
      shift = std::max(shift, difference);
    } else {
      scale = std::max(scale, std::abs(a.m[i]));
      linear = std::max(linear, difference);
    }
  }
  if (linear > kMatrixTolerance * scale) {
    const Vec3 sizes = a.Spacing() - b.Spacing();
    const bool same_size = std::max({std::abs(sizes.x), std::abs(sizes.y), std::abs(sizes.z)}) <=
                           kMatrixTolerance * scale;
    return same_size ? "the directions of the axes differ"
                     : fmt::format("voxel size {} and {}", Show(a.Spacing()), Show(b.Spacing()));
  }
  if (shift > kMatrixTolerance * std::max(scale, reach)) {
    return fmt::format("origin {} and {}", Show(a.TransformPoint({0, 0, 0})),
                       Show(b.TransformPoint({0, 0, 0})));
  }
  return {};
}

Box3 BoxOnLattice(const Box3& box, const Matrix4& index_to_world, const Matrix4& lattice) {
  if (box.IsEmpty()) {
    return {};
  }
  const Matrix4 to_lattice = lattice.Inverse();
  const auto map = [&](const Vec3& index) {
    return to_lattice.TransformPoint(index_to_world.TransformPoint(index));
  };
  const Vec3 first = map({0, 0, 0});
  const bool moved =
      IsNear(first, {std::round(first.x), std::round(first.y), std::round(first.z)}) &&
      IsNear(map({1, 0, 0}) - first, {1, 0, 0}) && IsNear(map({0, 1, 0}) - first, {0, 1, 0}) &&
      IsNear(map({0, 0, 1}) - first, {0, 0, 1});
  // A voxel reaches one further in every direction when it is interpolated.
  const double grown = moved ? 0 : 1;
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  Vec3 low{kInfinite, kInfinite, kInfinite};
  Vec3 high{-kInfinite, -kInfinite, -kInfinite};
  for (int corner = 0; corner < 8; ++corner) {
    const auto end = [&](int axis) {
      const bool last = ((corner >> axis) & 1) != 0;
      return last ? static_cast<double>(box.hi[axis] - 1) + grown
                  : static_cast<double>(box.lo[axis]) - grown;
    };
    const Vec3 at = map({end(0), end(1), end(2)});
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], at[axis]);
      high[axis] = std::max(high[axis], at[axis]);
    }
  }
  Box3 result;
  for (int axis = 0; axis < 3; ++axis) {
    result.lo[axis] = ToIndex(moved ? std::round(low[axis]) : std::floor(low[axis]));
    result.hi[axis] = ToIndex(moved ? std::round(high[axis]) : std::ceil(high[axis])) + 1;
  }
  return result;
}

}  // namespace fovea::ingest
