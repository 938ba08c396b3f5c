#ifndef ENGINE_FOVEA_RETAINED_SET_H_
#define ENGINE_FOVEA_RETAINED_SET_H_

#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

namespace fovea {

/// Where the detail is kept: the fovea x0 in voxel coordinates (0 to the dimensions, both ends
/// allowed) and the rate r0, the common width of the kept window in every sub-band (1 to 65536;
/// at rate >= n everything is kept).
struct Fovea {
  Vec3 at;
  double rate = 40;
};

/// The retained set C(x0, r0): the window of detail coefficients kept at each level, and the
/// nested boxes of super-voxels they stand for. Yu et al., eq. (1), in sub-band coordinates.
/// Immutable after Make.
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
  /// sub-band, round(x) = floor(x + 1/2). May be empty for a fovea on the far border.
  [[nodiscard]] const Box3& window(int level) const { return windows_[level]; }
  /// B_l, l = 0 .. L: the region that level l covers, in level-l coordinates. B_0 is everything,
  /// B_{l+1} is W_l doubled and clipped. Boxes nest.
  [[nodiscard]] const Box3& box(int level) const { return boxes_[level]; }
  /// m: all kept coefficients, zeros and LLL_0 included.
  [[nodiscard]] int64_t CoefficientCount() const;
  /// The super-voxels of the foveated volume: level-l ones outside W_l, summed over the levels.
  [[nodiscard]] int64_t SuperVoxelCount() const;

 private:
  Hierarchy hierarchy_;
  Fovea fovea_;
  std::vector<Box3> windows_;
  std::vector<Box3> boxes_;
};

}  // namespace fovea

#endif  // ENGINE_FOVEA_RETAINED_SET_H_
