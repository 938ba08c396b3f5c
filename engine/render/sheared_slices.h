#ifndef ENGINE_RENDER_SHEARED_SLICES_H_
#define ENGINE_RENDER_SHEARED_SLICES_H_

#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/render/view.h"
#include "engine/volume/grid.h"

/// Which pixels of the sheared (intermediate) images meet which slices, and on which side of the
/// window: the geometry of thick rays, without any values.
namespace fovea::render {

/// A half-open rectangle of pixels of one level's intermediate image.
struct Rect {
  int64_t u0 = 0, u1 = 0, v0 = 0, v1 = 0;
  [[nodiscard]] bool IsEmpty() const { return u1 <= u0 || v1 <= v0; }
  [[nodiscard]] int64_t Width() const { return u1 - u0; }
  [[nodiscard]] int64_t Height() const { return v1 - v0; }
  [[nodiscard]] bool Contains(int64_t u, int64_t v) const {
    return u >= u0 && u < u1 && v >= v0 && v < v1;
  }
  friend bool operator==(const Rect&, const Rect&) = default;
};

[[nodiscard]] Rect Intersect(const Rect& a, const Rect& b);
/// The same region in pixels half as wide.
[[nodiscard]] Rect Doubled(const Rect& rect);

/// Where a slice samples, in its level's units: pixel i stands at i + 1/2 + shift.
struct SliceShift {
  double u = 0, v = 0;
};

/// The pixels of a slice whose centres lie inside [lo_u, hi_u) x [lo_v, hi_v) (level units).
[[nodiscard]] Rect PixelsInside(double lo_u, double hi_u, double lo_v, double hi_v,
                                const SliceShift& shift);

/// One slice of one level. Slices are stored by k in storage order.
struct SlicePlan {
  int64_t k = 0;
  SliceShift shift;
  Rect owned;  // what levels below and at this one draw in this slice
  Rect child;  // R: the part of it that the next level draws; may be empty
  Rect back;   // columns back.u0..u1 and rows back.v0..v1 that lie beyond a leaving edge
  enum class Place { kBefore, kWithin, kBehind } place = Place::kBefore;  // the window's slices
  Rect in_volume;        // pixels whose centre lies inside the volume: only they sample
  double thickness = 1;  // of the slab, in this level's voxels: less than 1 at the far border
};

/// One level of the intermediate image: its pixels and its slices, first the nearest to the viewer.
struct LevelPlan {
  int level = 0;
  int64_t width = 1;  // w: voxels a pixel
  Rect rect;
  /// Sides of rect beyond which there is no volume (else: a coarser level's pixels).
  bool void_u0 = true, void_u1 = true, void_v0 = true, void_v1 = true;
  /// Pixels whose ray, and whose ancestors' rays, enter the volume's near face and leave its far
  /// face: nothing is missing from what they gather.
  Rect crossing;
  std::vector<SlicePlan> slices;

  /// Whether a pixel outside rect lies where there is no volume.
  [[nodiscard]] bool IsVoid(int64_t u, int64_t v) const {
    return (u < rect.u0 && void_u0) || (u >= rect.u1 && void_u1) || (v < rect.v0 && void_v0) ||
           (v >= rect.v1 && void_v1);
  }
};

/// The pixels one voxel wide whose rays can meet the volume: full resolution's sheared image, and
/// what no picture draws beyond.
[[nodiscard]] Rect SheetRect(const Int3& dims, const ShearView& view);

/// Levels 0, 1, ... as far as any pixel is owned. ALGORITHM: ownership, front or back.
[[nodiscard]] std::vector<LevelPlan> PlanLevels(const RetainedSet& retained, const ShearView& view);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SHEARED_SLICES_H_
