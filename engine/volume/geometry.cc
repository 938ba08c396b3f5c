#include "engine/volume/geometry.h"

#include <cmath>

namespace fovea {

double Dot(const Vec3& a, const Vec3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

Vec3 Cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

double Length(const Vec3& a) {
  return std::sqrt(Dot(a, a));
}

bool Box3::Contains(const Box3& other) const {
  return other.IsEmpty() || Intersect(*this, other) == other;
}

Box3 Box3::Grown(int64_t margin) const {
  return {{lo.x - margin, lo.y - margin, lo.z - margin},
          {hi.x + margin, hi.y + margin, hi.z + margin}};
}

Box3 Intersect(const Box3& a, const Box3& b) {
  Box3 result;
  for (int axis = 0; axis < 3; ++axis) {
    result.lo[axis] = std::max(a.lo[axis], b.lo[axis]);
    result.hi[axis] = std::min(a.hi[axis], b.hi[axis]);
  }
  return result;
}

Box3 Union(const Box3& a, const Box3& b) {
  if (a.IsEmpty()) {
    return b;
  }
  if (b.IsEmpty()) {
    return a;
  }
  Box3 result;
  for (int axis = 0; axis < 3; ++axis) {
    result.lo[axis] = std::min(a.lo[axis], b.lo[axis]);
    result.hi[axis] = std::max(a.hi[axis], b.hi[axis]);
  }
  return result;
}

Vec3 Matrix4::TransformPoint(const Vec3& p) const {
  return TransformDirection(p) + Vec3{m[3], m[7], m[11]};
}

Vec3 Matrix4::TransformDirection(const Vec3& d) const {
  return {m[0] * d.x + m[1] * d.y + m[2] * d.z, m[4] * d.x + m[5] * d.y + m[6] * d.z,
          m[8] * d.x + m[9] * d.y + m[10] * d.z};
}

Vec3 Matrix4::Spacing() const {
  return {Length({m[0], m[4], m[8]}), Length({m[1], m[5], m[9]}), Length({m[2], m[6], m[10]})};
}

double Matrix4::SmallestSpacing() const {
  const Vec3 spacing = Spacing();
  return std::min({spacing.x, spacing.y, spacing.z});
}

double Matrix4::Determinant() const {
  return Dot({m[0], m[1], m[2]}, Cross({m[4], m[5], m[6]}, {m[8], m[9], m[10]}));
}

Matrix4 Matrix4::Inverse() const {
  const double scale = 1.0 / Determinant();
  const Vec3 a = {m[0], m[1], m[2]};
  const Vec3 b = {m[4], m[5], m[6]};
  const Vec3 c = {m[8], m[9], m[10]};
  const Vec3 columns[3] = {scale * Cross(b, c), scale * Cross(c, a), scale * Cross(a, b)};
  Matrix4 inverse;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      inverse.m[4 * row + column] = columns[column][row];
    }
  }
  const Vec3 shift = inverse.TransformDirection({m[3], m[7], m[11]});
  for (int row = 0; row < 3; ++row) {
    inverse.m[4 * row + 3] = -shift[row];
  }
  return inverse;
}

}  // namespace fovea
