#ifndef ENGINE_RENDER_PERSPECTIVE_SLICES_H_
#define ENGINE_RENDER_PERSPECTIVE_SLICES_H_

#include <array>
#include <optional>
#include <vector>

#include "engine/fovea/retained_set.h"
#include "engine/render/perspective_view.h"
#include "engine/render/sheared_slices.h"

/// Which pixels of a face's images meet which slices, and on which side of the window: the
/// geometry of thick rays in perspective, without any values.
namespace fovea::render {

/// One slice of one level: of a slab with the eye in it only the part beyond, sampled at that
/// part's middle. Pixels are w voxels wide on the reference plane.
struct PerspectiveSlice {
  int64_t k = 0;
  double z = 0;          // where it samples, in voxels
  double scale = 1;      // PerspectiveFace::Scale(z)
  double thickness = 1;  // in this level's voxels; less than 1 at the far border and at the eye
  Rect in_volume;        // pixels whose ray lies inside the volume at z: only they sample
  Rect owned;            // what this level and finer ones draw in this slice
  Rect child;            // the part of it that the next level draws; may be empty
  Rect staying;          // pixels beyond no edge that leaves them, going away from the eye
  SlicePlan::Place place = SlicePlan::Place::kBefore;
};

/// One level of a face's image. `plan` holds everything but its slices, which are here, first the
/// nearest to the eye.
struct PerspectiveLevel {
  LevelPlan plan;
  std::vector<PerspectiveSlice> slices;
};

/// Who draws a run of pixels [begin, end) of a row of a slice.
enum class Side { kFront, kBack, kChild };
struct SideRun {
  int64_t begin = 0, end = 0;
  Side side = Side::kFront;
};

/// The runs that make up row v of slice.owned, in order; some may be empty.
[[nodiscard]] std::array<SideRun, 5> RunsOfRow(const PerspectiveSlice& slice, int64_t v);

/// Slices, edges and borders of one level of a face.
class PerspectivePlanner {
 public:
  PerspectivePlanner(const RetainedSet& retained, const PerspectiveFace& face, int level);

  /// Slice k without owner, or nothing if it is not beyond the eye.
  [[nodiscard]] std::optional<PerspectiveSlice> BareSlice(int64_t k) const;
  /// Ownership and side of the pixels of `slice->owned`.
  void PlaceWindow(PerspectiveSlice* slice) const;
  /// The slices of the level, first the nearest to the eye, without owners.
  [[nodiscard]] std::vector<PerspectiveSlice> BareSlices() const;
  /// What the picture can see of the face's volume, with a margin for interpolation.
  [[nodiscard]] Rect SeenPixels() const;
  /// The pixels whose ray meets the volume, and the rectangle around them.
  [[nodiscard]] Rect VolumePixels() const;
  /// The pixels whose ray enters the volume's near face (or starts inside) and leaves its far face.
  [[nodiscard]] Rect CrossingPixels() const;
  [[nodiscard]] const Int3& dims() const { return dims_; }

 private:
  [[nodiscard]] Rect PixelsBetween(const std::array<double, 4>& edges, double scale) const;
  [[nodiscard]] int64_t FirstPixel(int axis, double edge, double scale) const;
  [[nodiscard]] double LowEdge(int axis) const;
  [[nodiscard]] double HighEdge(int axis) const;
  [[nodiscard]] double Extent(int axis) const;
  [[nodiscard]] double SampledExtent(int axis) const;

  const RetainedSet& retained_;
  const PerspectiveFace& face_;
  int level_;
  double width_ = 1;
  Int3 dims_;
  Vec3 eye_;  // in this level's units
  bool has_window_ = false;
};

/// The voxel-wide pixels that a face's picture is made of.
[[nodiscard]] Rect FaceRect(const RetainedSet& retained, const PerspectiveFace& face);

/// Levels 0, 1, ... as far as any pixel is owned; none if the picture does not see the volume
/// through this face. ALGORITHM: ownership, front or back, perspective.
[[nodiscard]] std::vector<PerspectiveLevel> PlanLevels(const RetainedSet& retained,
                                                       const PerspectiveFace& face);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PERSPECTIVE_SLICES_H_
