#ifndef ENGINE_VOLUME_HIERARCHY_H_
#define ENGINE_VOLUME_HIERARCHY_H_

#include "engine/base/status.h"
#include "engine/volume/geometry.h"

namespace fovea {

/// The largest size of an axis in voxels: every index and product in the engine then fits 64 bits.
inline constexpr int64_t kMaxDimension = 65536;
/// Halving stops when every axis is at most this long.
inline constexpr int64_t kCoarsestDimension = 16;

/// The levels of a volume: level 0 is the coarsest, level L holds the voxels; all axes are halved
/// together, rounding up, L times, until each is at most 16. A super-voxel of level l at position
/// p covers [p, p+1) * w voxels, w = 2^(L-l); at the far border it may overhang the volume.
/// Immutable after Make.
class Hierarchy {
 public:
  Hierarchy() = default;
  /// INVALID_ARGUMENT unless every axis is 1 to kMaxDimension.
  [[nodiscard]] static StatusOr<Hierarchy> Make(const Int3& dims);

  /// The voxels as the only level, never halved. Each axis must be 1 to kMaxDimension.
  [[nodiscard]] static Hierarchy Flat(const Int3& dims);

  /// Voxels on each axis.
  [[nodiscard]] const Int3& dims() const { return dims_; }
  /// L: how often the volume is halved; the voxels are level L.
  [[nodiscard]] int finest() const { return finest_; }
  /// Super-voxels on each axis at `level`: ceil(dims / w).
  [[nodiscard]] Int3 DimsAt(int level) const;
  /// w: the width in voxels of a super-voxel of `level`.
  [[nodiscard]] int64_t WidthAt(int level) const { return int64_t{1} << (finest_ - level); }
  friend bool operator==(const Hierarchy&, const Hierarchy&) = default;

 private:
  Int3 dims_{1, 1, 1};
  int finest_ = 0;
};

}  // namespace fovea

#endif  // ENGINE_VOLUME_HIERARCHY_H_
