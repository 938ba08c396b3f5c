#ifndef ENGINE_VOLUME_GEOMETRY_H_
#define ENGINE_VOLUME_GEOMETRY_H_

#include <algorithm>
#include <array>
#include <cstdint>

/// Points, boxes and matrices. Voxel i of an axis covers [i, i+1) in voxel coordinates.
namespace fovea {

/// A point or a size on a grid: x, y, z by index 0, 1, 2.
struct Int3 {
  int64_t x = 0, y = 0, z = 0;
  [[nodiscard]] int64_t operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
  int64_t& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  friend bool operator==(const Int3&, const Int3&) = default;
  /// The product x * y * z; for a size, how many items it holds.
  [[nodiscard]] int64_t Product() const { return x * y * z; }
  [[nodiscard]] int64_t Max() const { return std::max({x, y, z}); }
};

/// A point or a direction in voxel or world coordinates.
struct Vec3 {
  double x = 0, y = 0, z = 0;
  [[nodiscard]] double operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
  double& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  friend bool operator==(const Vec3&, const Vec3&) = default;
  friend Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend Vec3 operator*(double s, const Vec3& a) { return {s * a.x, s * a.y, s * a.z}; }
};

[[nodiscard]] double Dot(const Vec3& a, const Vec3& b);
[[nodiscard]] Vec3 Cross(const Vec3& a, const Vec3& b);
[[nodiscard]] double Length(const Vec3& a);

/// A half-open box of grid points: lo is inside, hi is not. Empty if hi <= lo on any axis.
struct Box3 {
  Int3 lo, hi;
  friend bool operator==(const Box3&, const Box3&) = default;
  [[nodiscard]] static Box3 OfSize(const Int3& size) { return {{0, 0, 0}, size}; }
  [[nodiscard]] bool IsEmpty() const { return hi.x <= lo.x || hi.y <= lo.y || hi.z <= lo.z; }
  /// The extent of each axis, never negative.
  [[nodiscard]] Int3 Size() const {
    return {std::max<int64_t>(0, hi.x - lo.x), std::max<int64_t>(0, hi.y - lo.y),
            std::max<int64_t>(0, hi.z - lo.z)};
  }
  [[nodiscard]] int64_t Volume() const { return Size().Product(); }
  [[nodiscard]] bool Contains(const Int3& p) const {
    return p.x >= lo.x && p.x < hi.x && p.y >= lo.y && p.y < hi.y && p.z >= lo.z && p.z < hi.z;
  }
  /// Whether `other` lies wholly inside; an empty box lies inside every box.
  [[nodiscard]] bool Contains(const Box3& other) const;
  /// Larger by `margin` on all six sides.
  [[nodiscard]] Box3 Grown(int64_t margin) const;
};

[[nodiscard]] Box3 Intersect(const Box3& a, const Box3& b);
/// The smallest box around both; an empty box adds nothing.
[[nodiscard]] Box3 Union(const Box3& a, const Box3& b);

/// A 4x4 affine matrix, row by row: world = M (x, y, z, 1) with (x, y, z) in voxel coordinates.
struct Matrix4 {
  std::array<double, 16> m{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  friend bool operator==(const Matrix4&, const Matrix4&) = default;
  [[nodiscard]] Vec3 TransformPoint(const Vec3& p) const;
  [[nodiscard]] Vec3 TransformDirection(const Vec3& d) const;
  /// The length in the world of one step along each axis: the voxel spacing.
  [[nodiscard]] Vec3 Spacing() const;
  [[nodiscard]] double SmallestSpacing() const;
  /// Determinant of the upper-left 3x3; 0 or not finite means the matrix cannot be used.
  [[nodiscard]] double Determinant() const;
  /// Inverse of an affine matrix whose Determinant is not 0.
  [[nodiscard]] Matrix4 Inverse() const;
};

}  // namespace fovea

#endif  // ENGINE_VOLUME_GEOMETRY_H_
