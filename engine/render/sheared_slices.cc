#include "engine/render/sheared_slices.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fovea::render {

Rect Intersect(const Rect& a, const Rect& b) {
  return {std::max(a.u0, b.u0), std::min(a.u1, b.u1), std::max(a.v0, b.v0), std::min(a.v1, b.v1)};
}

Rect Doubled(const Rect& rect) {
  return {2 * rect.u0, 2 * rect.u1, 2 * rect.v0, 2 * rect.v1};
}

namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr int64_t kFar = int64_t{1} << 40;  // a pixel no image reaches

/// The first pixel whose centre, at i + 1/2 + shift, is not before `edge`. Monotone in the shift,
/// so that an edge admits a pixel for a prefix or a suffix of the slices.
int64_t FirstPixel(double edge, double shift) {
  if (std::isinf(edge)) {
    return edge > 0 ? kFar : -kFar;
  }
  return static_cast<int64_t>(std::ceil(edge - shift - 0.5));
}

}  // namespace

Rect PixelsInside(double lo_u, double hi_u, double lo_v, double hi_v, const SliceShift& shift) {
  return {FirstPixel(lo_u, shift.u), FirstPixel(hi_u, shift.u), FirstPixel(lo_v, shift.v),
          FirstPixel(hi_v, shift.v)};
}

namespace {

/// What plans of one level need to know of the volume, in that level's units.
class LevelPlanner {
 public:
  LevelPlanner(const RetainedSet& retained, const ShearView& view, int level)
      : retained_(retained), view_(view), level_(level) {
    const Hierarchy& hierarchy = retained.hierarchy();
    width_ = static_cast<double>(hierarchy.WidthAt(level));
    dims_ = hierarchy.DimsAt(level);
    has_window_ = level < hierarchy.finest() && !retained.window(level).IsEmpty();
  }

  /// The slice's shift and the pixels of it that lie inside the volume.
  [[nodiscard]] SlicePlan BareSlice(int64_t k) const {
    SlicePlan slice;
    slice.k = k;
    // The last super-voxel in storage order may overhang: it is as thick as its part inside, and
    // is sampled in the middle of that.
    slice.thickness = std::min(1.0, Extent(view_.axis_k) - static_cast<double>(k));
    const double z = static_cast<double>(k) + slice.thickness / 2;
    slice.shift = {view_.slope_u * z, view_.slope_v * z};
    slice.in_volume =
        PixelsInside(0, SampledExtent(view_.axis_u), 0, SampledExtent(view_.axis_v), slice.shift);
    return slice;
  }

  /// The pixels whose ray enters the volume's near face and leaves its far face.
  [[nodiscard]] Rect CrossingPixels() const {
    const double depth = Extent(view_.axis_k);
    const auto at_face = [&](const SliceShift& shift) {
      return PixelsInside(0, Extent(view_.axis_u), 0, Extent(view_.axis_v), shift);
    };
    return Intersect(at_face({0, 0}), at_face({view_.slope_u * depth, view_.slope_v * depth}));
  }

  /// Ownership and side: which pixels of `slice.owned` the window takes, and what lies beyond an
  /// edge that is leaving.
  void PlaceWindow(SlicePlan* slice) const {
    slice->place = SlicePlan::Place::kBefore;
    slice->back = {};
    if (!has_window_) {
      return;
    }
    const Box3& window = retained_.window(level_);
    const int64_t first = window.lo[view_.axis_k];
    const int64_t last = window.hi[view_.axis_k] - 1;
    if (view_.ascending ? slice->k > last : slice->k < first) {
      slice->place = SlicePlan::Place::kBehind;
      return;
    }
    if (view_.ascending ? slice->k < first : slice->k > last) {
      return;
    }
    slice->place = SlicePlan::Place::kWithin;
    const Rect window_rect =
        PixelsInside(LowEdge(view_.axis_u), HighEdge(view_.axis_u), LowEdge(view_.axis_v),
                     HighEdge(view_.axis_v), slice->shift);
    slice->child = Intersect(slice->owned, window_rect);
    slice->back = BeyondLeavingEdges(window_rect);
  }

  /// The volume's extent on an axis, in this level's units; not whole where it overhangs.
  [[nodiscard]] double Extent(int axis) const {
    return static_cast<double>(retained_.hierarchy().dims()[axis]) / width_;
  }
  /// How far samples count on an axis: to the volume's border, but at least to the centre of the
  /// last super-voxel, or one that overhangs by half would never be drawn.
  [[nodiscard]] double SampledExtent(int axis) const {
    constexpr double kJustPast = 1e-9;
    return std::max(Extent(axis), static_cast<double>(dims_[axis]) - 0.5 + kJustPast);
  }
  [[nodiscard]] const Int3& dims() const { return dims_; }
  [[nodiscard]] bool has_window() const { return has_window_; }

 private:
  // A window edge on the volume's border counts as infinitely far out.
  [[nodiscard]] double LowEdge(int axis) const {
    const int64_t lo = retained_.window(level_).lo[axis];
    return lo <= 0 ? -kInfinite : static_cast<double>(lo);
  }
  [[nodiscard]] double HighEdge(int axis) const {
    const int64_t hi = retained_.window(level_).hi[axis];
    return hi >= dims_[axis] ? kInfinite : static_cast<double>(hi);
  }

  /// Going away from the viewer, the window moves by -slope a slice (ascending) in sheared
  /// coordinates. The edge behind it uncovers pixels; they, and all beyond, go to the back.
  [[nodiscard]] Rect BeyondLeavingEdges(const Rect& window_rect) const {
    const double sign = view_.ascending ? 1 : -1;
    Rect back;  // empty ranges
    const double motion_u = -sign * view_.slope_u;
    const double motion_v = -sign * view_.slope_v;
    if (motion_u > 0) {
      back.u0 = -kFar;
      back.u1 = window_rect.u0;
    } else if (motion_u < 0) {
      back.u0 = window_rect.u1;
      back.u1 = kFar;
    }
    if (motion_v > 0) {
      back.v0 = -kFar;
      back.v1 = window_rect.v0;
    } else if (motion_v < 0) {
      back.v0 = window_rect.v1;
      back.v1 = kFar;
    }
    return back;
  }

  const RetainedSet& retained_;
  const ShearView& view_;
  int level_;
  double width_ = 1;
  Int3 dims_;
  bool has_window_ = false;
};

/// Level 0's image: every pixel a ray through the volume can meet.
Rect CoarsestRect(const LevelPlanner& planner, const ShearView& view) {
  const auto range = [&](int axis, double slope, int64_t* lo, int64_t* hi) {
    const double drift = slope * planner.Extent(view.axis_k);
    const auto cells = static_cast<double>(planner.dims()[axis]);
    *lo = static_cast<int64_t>(std::floor(-std::max(drift, 0.0)));
    *hi = static_cast<int64_t>(std::ceil(cells - std::min(drift, 0.0)));
  };
  Rect rect;
  range(view.axis_u, view.slope_u, &rect.u0, &rect.u1);
  range(view.axis_v, view.slope_v, &rect.v0, &rect.v1);
  return rect;
}

/// The rectangle around what the next level draws, over all slices, in this level's pixels.
Rect ChildBounds(const LevelPlan& plan) {
  Rect bounds{kFar, -kFar, kFar, -kFar};
  for (const SlicePlan& slice : plan.slices) {
    if (!slice.child.IsEmpty()) {
      bounds = {std::min(bounds.u0, slice.child.u0), std::max(bounds.u1, slice.child.u1),
                std::min(bounds.v0, slice.child.v0), std::max(bounds.v1, slice.child.v1)};
    }
  }
  return bounds;
}

/// The slices of the level below `coarser`: children 2k and 2k+1 use the parent's rectangle.
void AddChildSlices(const LevelPlan& coarser, const LevelPlanner& planner, const ShearView& view,
                    LevelPlan* plan) {
  for (const SlicePlan& parent : coarser.slices) {
    if (parent.child.IsEmpty()) {
      continue;
    }
    for (int i = 0; i < 2; ++i) {
      const int64_t k = 2 * parent.k + (view.ascending ? i : 1 - i);
      if (k >= planner.dims()[view.axis_k]) {
        continue;
      }
      SlicePlan slice = planner.BareSlice(k);
      slice.owned = Doubled(parent.child);
      planner.PlaceWindow(&slice);
      plan->slices.push_back(slice);
    }
  }
}

}  // namespace

Rect SheetRect(const Int3& dims, const ShearView& view) {
  const auto range = [&](int64_t size, double slope, int64_t* lo, int64_t* hi) {
    const double drift = slope * static_cast<double>(dims[view.axis_k]);
    *lo = static_cast<int64_t>(std::floor(-std::max(drift, 0.0)));
    *hi = size + static_cast<int64_t>(std::ceil(-std::min(drift, 0.0)));
  };
  Rect rect;
  range(dims[view.axis_u], view.slope_u, &rect.u0, &rect.u1);
  range(dims[view.axis_v], view.slope_v, &rect.v0, &rect.v1);
  return rect;
}

std::vector<LevelPlan> PlanLevels(const RetainedSet& retained, const ShearView& view) {
  std::vector<LevelPlan> levels;
  for (int level = 0; level <= retained.hierarchy().finest(); ++level) {
    const LevelPlanner planner(retained, view, level);
    LevelPlan plan;
    plan.level = level;
    plan.width = retained.hierarchy().WidthAt(level);
    plan.crossing = planner.CrossingPixels();
    if (level == 0) {
      plan.rect = CoarsestRect(planner, view);
      const int64_t count = planner.dims()[view.axis_k];
      for (int64_t i = 0; i < count; ++i) {
        SlicePlan slice = planner.BareSlice(view.ascending ? i : count - 1 - i);
        slice.owned = plan.rect;
        planner.PlaceWindow(&slice);
        plan.slices.push_back(slice);
      }
    } else {
      const LevelPlan& coarser = levels.back();
      const Rect bounds = ChildBounds(coarser);
      if (bounds.IsEmpty()) {
        break;
      }
      plan.rect = Doubled(bounds);
      plan.crossing = Intersect(plan.crossing, Doubled(coarser.crossing));
      plan.void_u0 = coarser.void_u0 && bounds.u0 == coarser.rect.u0;
      plan.void_u1 = coarser.void_u1 && bounds.u1 == coarser.rect.u1;
      plan.void_v0 = coarser.void_v0 && bounds.v0 == coarser.rect.v0;
      plan.void_v1 = coarser.void_v1 && bounds.v1 == coarser.rect.v1;
      AddChildSlices(coarser, planner, view, &plan);
    }
    levels.push_back(std::move(plan));
  }
  return levels;
}

}  // namespace fovea::render
