#ifndef ENGINE_FOVEA_RETAINED_SET_H_
#define ENGINE_FOVEA_RETAINED_SET_H_

#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

namespace fovea {

/// The rate r0 along each axis: how many coefficients wide the kept window is there, in every
/// sub-band. 1 to 65536, rounded; from n on (the volume's largest dimension) the axis is kept
/// whole.
struct Rate {
  double x = 40, y = 40, z = 40;
  Rate() = default;
  /// A number is the same rate along every axis.
  Rate(double all) : x(all), y(all), z(all) {}  // NOLINT(google-explicit-constructor)
  Rate(double along_x, double along_y, double along_z) : x(along_x), y(along_y), z(along_z) {}
  [[nodiscard]] double operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
  [[nodiscard]] bool IsIsotropic() const { return x == y && y == z; }
  friend bool operator==(const Rate&, const Rate&) = default;
};

/// 'R', or 'RX,RY,RZ' where they differ.
[[nodiscard]] std::string FormatRate(const Rate& rate);

/// Which coefficients of a window count, and how much. Yu et al., section 2.1: circles and weights
/// are "a better approximation" than squares.
enum class WindowShape {
  /// All of them: the paper's squares.
  kCube,
  /// Those whose cell's centre lies in the ball (with rates that differ: the ellipsoid) around the
  /// fovea whose diameter is the rate: about pi/6 of the cube's.
  kSphere,
  /// All of them, times a product of one raised cosine an axis: 1 in the inner half of the window,
  /// falling towards 0 at its border. As many as the cube keeps.
  kSmooth,
};

/// Where the detail is kept: the fovea x0 in voxel coordinates (0 to the dimensions, both ends
/// allowed), how wide, and in which shape.
struct Fovea {
  Vec3 at;
  Rate rate;
  WindowShape window = WindowShape::kCube;
};

/// The retained set C(x0, r0): the window of detail coefficients kept at each level, their weights
/// in it, and the nested boxes of super-voxels they stand for. Yu et al., eq. (1), in sub-band
/// coordinates. Immutable after Make.
class RetainedSet {
 public:
  RetainedSet() = default;
  /// INVALID_ARGUMENT, naming value and range, for a fovea outside the volume or a bad rate.
  [[nodiscard]] static StatusOr<RetainedSet> Make(const Hierarchy& hierarchy, const Fovea& fovea);

  /// Every voxel of a volume of `dims` voxels (each 1 to kMaxDimension) as a single level.
  [[nodiscard]] static RetainedSet Whole(const Int3& dims, const Vec3& fovea);

  [[nodiscard]] const Hierarchy& hierarchy() const { return hierarchy_; }
  [[nodiscard]] const Fovea& fovea() const { return fovea_; }
  /// W_l, l = 0 .. L-1, in level-l coordinates: lo = round(c - W/2) a side, clipped to the
  /// sub-band, round(x) = floor(x + 1/2). May be empty for a fovea on the far border. A box
  /// whatever the shape.
  [[nodiscard]] const Box3& window(int level) const { return windows_[level]; }
  /// B_l, l = 0 .. L: the region that level l covers, in level-l coordinates. B_0 is everything,
  /// B_{l+1} is W_l doubled and clipped. Boxes nest.
  [[nodiscard]] const Box3& box(int level) const { return boxes_[level]; }

  /// The weight, 0 to 1, of the seven detail coefficients of level `level` at `p`: 0 outside the
  /// window. Never more than that of their parent, at p/2 of the level before.
  [[nodiscard]] float Weight(int level, const Int3& p) const;
  /// Multiplies detail [7][z][y][x] over `box`, which lies within the window, by the weights.
  /// Nothing to do, and nothing done, for cubes.
  void Weigh(int level, const Box3& box, std::span<float> detail) const;

  /// m: all coefficients whose weight is not 0, zeros and LLL_0 included. O(1) for cubes and smooth
  /// windows; O(r0^2 log r0) a level for spheres.
  [[nodiscard]] int64_t CoefficientCount() const;
  /// The super-voxels that are made and drawn: level-l ones of B_l outside W_l, summed over the
  /// levels. For cubes as many as coefficients, but for odd sizes.
  [[nodiscard]] int64_t SuperVoxelCount() const;

 private:
  [[nodiscard]] double Term(int level, int axis, int64_t p) const;
  [[nodiscard]] std::vector<double> Terms(int level, int axis, const Box3& box) const;
  [[nodiscard]] int64_t CountInBall(int level) const;

  Hierarchy hierarchy_;
  Fovea fovea_;
  std::vector<Box3> windows_;
  std::vector<Box3> boxes_;
};

}  // namespace fovea

#endif  // ENGINE_FOVEA_RETAINED_SET_H_
