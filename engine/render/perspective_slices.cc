#include "engine/render/perspective_slices.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fovea::render {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr int64_t kFar = int64_t{1} << 40;  // a pixel no image reaches
/// Less of a slab than this beyond the eye is nothing, in voxels.
constexpr double kLeastPart = 1e-6;
/// Coarsest pixels around what the picture asks for: interpolation, smooth splitting and the
/// sharpening of means look at neighbours.
constexpr int64_t kMargin = 2;

int64_t ClampedPixel(double pixel) {
  return static_cast<int64_t>(
      std::clamp(pixel, -static_cast<double>(kFar), static_cast<double>(kFar)));
}

Rect Scaled(const Rect& rect, int64_t by) {
  return {rect.u0 * by, rect.u1 * by, rect.v0 * by, rect.v1 * by};
}

}  // namespace

std::array<SideRun, 5> RunsOfRow(const PerspectiveSlice& slice, int64_t v) {
  const int64_t begin = slice.owned.u0;
  const int64_t end = slice.owned.u1;
  std::array<SideRun, 5> runs{};
  const bool within = slice.place == SlicePlan::Place::kWithin;
  if (!within || v < slice.staying.v0 || v >= slice.staying.v1) {
    const bool before = slice.place == SlicePlan::Place::kBefore;
    runs[0] = {begin, end, before ? Side::kFront : Side::kBack};
    return runs;
  }
  const int64_t stay0 = std::clamp(slice.staying.u0, begin, end);
  const int64_t stay1 = std::clamp(slice.staying.u1, stay0, end);
  int64_t child0 = stay1;
  int64_t child1 = stay1;
  if (v >= slice.child.v0 && v < slice.child.v1 && slice.child.u1 > slice.child.u0) {
    child0 = slice.child.u0;
    child1 = slice.child.u1;
  }
  runs[0] = {begin, stay0, Side::kBack};
  runs[1] = {stay0, child0, Side::kFront};
  runs[2] = {child0, child1, Side::kChild};
  runs[3] = {child1, stay1, Side::kFront};
  runs[4] = {stay1, end, Side::kBack};
  return runs;
}

PerspectivePlanner::PerspectivePlanner(const RetainedSet& retained, const PerspectiveFace& face,
                                       int level)
    : retained_(retained), face_(face), level_(level) {
  const Hierarchy& hierarchy = retained.hierarchy();
  width_ = static_cast<double>(hierarchy.WidthAt(level));
  dims_ = hierarchy.DimsAt(level);
  eye_ = (1 / width_) * face.eye;
  has_window_ = level < hierarchy.finest() && !retained.window(level).IsEmpty();
}

double PerspectivePlanner::Extent(int axis) const {
  return static_cast<double>(retained_.hierarchy().dims()[axis]) / width_;
}

// To the volume's border, but at least to the centre of the last super-voxel (decision 0001).
double PerspectivePlanner::SampledExtent(int axis) const {
  constexpr double kJustPast = 1e-9;
  return std::max(Extent(axis), static_cast<double>(dims_[axis]) - 0.5 + kJustPast);
}

// A window edge on the volume's border counts as infinitely far out.
double PerspectivePlanner::LowEdge(int axis) const {
  const int64_t lo = retained_.window(level_).lo[axis];
  return lo <= 0 ? -kInfinite : static_cast<double>(lo);
}

double PerspectivePlanner::HighEdge(int axis) const {
  const int64_t hi = retained_.window(level_).hi[axis];
  return hi >= dims_[axis] ? kInfinite : static_cast<double>(hi);
}

/// The first pixel whose ray has passed `edge` at a depth. Monotone in the scale, so that an edge
/// admits a pixel for a prefix or a suffix of the slices.
int64_t PerspectivePlanner::FirstPixel(int axis, double edge, double scale) const {
  return ClampedPixel(std::ceil(eye_[axis] + (edge - eye_[axis]) / scale - 0.5));
}

/// Edges: low and high of u, low and high of v.
Rect PerspectivePlanner::PixelsBetween(const std::array<double, 4>& edges, double scale) const {
  return {FirstPixel(face_.axis_u, edges[0], scale), FirstPixel(face_.axis_u, edges[1], scale),
          FirstPixel(face_.axis_v, edges[2], scale), FirstPixel(face_.axis_v, edges[3], scale)};
}

std::optional<PerspectiveSlice> PerspectivePlanner::BareSlice(int64_t k) const {
  const int axis = face_.axis_k;
  double lo = static_cast<double>(k) * width_;
  double hi = std::min(lo + width_, static_cast<double>(retained_.hierarchy().dims()[axis]));
  (face_.ascending ? lo : hi) =
      face_.ascending ? std::max(lo, face_.eye[axis]) : std::min(hi, face_.eye[axis]);
  if (hi - lo < kLeastPart) {
    return std::nullopt;
  }
  PerspectiveSlice slice;
  slice.k = k;
  slice.z = (lo + hi) / 2;
  slice.scale = face_.Scale(slice.z);
  slice.thickness = (hi - lo) / width_;
  slice.in_volume =
      PixelsBetween({0, SampledExtent(face_.axis_u), 0, SampledExtent(face_.axis_v)}, slice.scale);
  return slice;
}

std::vector<PerspectiveSlice> PerspectivePlanner::BareSlices() const {
  std::vector<PerspectiveSlice> slices;
  const int64_t count = dims_[face_.axis_k];
  for (int64_t i = 0; i < count; ++i) {
    if (const auto slice = BareSlice(face_.ascending ? i : count - 1 - i)) {
      slices.push_back(*slice);
    }
  }
  return slices;
}

void PerspectivePlanner::PlaceWindow(PerspectiveSlice* slice) const {
  slice->place = SlicePlan::Place::kBefore;
  slice->child = {};
  slice->staying = {-kFar, kFar, -kFar, kFar};
  if (!has_window_) {
    return;
  }
  const Box3& window = retained_.window(level_);
  const int64_t first = window.lo[face_.axis_k];
  const int64_t last = window.hi[face_.axis_k] - 1;
  if (face_.ascending ? slice->k > last : slice->k < first) {
    slice->place = SlicePlan::Place::kBehind;
    return;
  }
  if (face_.ascending ? slice->k < first : slice->k > last) {
    return;
  }
  slice->place = SlicePlan::Place::kWithin;
  const std::array<double, 4> edges = {LowEdge(face_.axis_u), HighEdge(face_.axis_u),
                                       LowEdge(face_.axis_v), HighEdge(face_.axis_v)};
  const Rect inside = PixelsBetween(edges, slice->scale);
  slice->child = Intersect(slice->owned, inside);
  // Going away, edges close in on the eye's own place. A low edge below it, or a high edge above
  // it, leaves the pixels that it passes; they and all beyond go to the back.
  const double eye_u = eye_[face_.axis_u];
  const double eye_v = eye_[face_.axis_v];
  slice->staying.u0 = edges[0] < eye_u ? inside.u0 : -kFar;
  slice->staying.u1 = edges[1] > eye_u ? inside.u1 : kFar;
  slice->staying.v0 = edges[2] < eye_v ? inside.v0 : -kFar;
  slice->staying.v1 = edges[3] > eye_v ? inside.v1 : kFar;
}

Rect PerspectivePlanner::SeenPixels() const {
  const double reach = (face_.reference_z - face_.eye[face_.axis_k]) / width_;
  const auto range = [&](int axis, double slope0, double slope1, int64_t* lo, int64_t* hi) {
    const double a = eye_[axis] + slope0 * reach;
    const double b = eye_[axis] + slope1 * reach;
    *lo = ClampedPixel(std::floor(std::min(a, b))) - kMargin;
    *hi = ClampedPixel(std::ceil(std::max(a, b))) + kMargin;
  };
  Rect rect;
  range(face_.axis_u, face_.slope_u0, face_.slope_u1, &rect.u0, &rect.u1);
  range(face_.axis_v, face_.slope_v0, face_.slope_v1, &rect.v0, &rect.v1);
  return rect;
}

Rect PerspectivePlanner::VolumePixels() const {
  const double reach = std::abs(face_.reference_z - face_.eye[face_.axis_k]);
  const auto range = [&](int axis, int64_t* lo, int64_t* hi) {
    const auto cells = static_cast<double>(dims_[axis]);
    double low = kInfinite;
    double high = -kInfinite;
    for (const double distance : {std::max(face_.near, kLeastPart), face_.far}) {
      for (const double edge : {0.0, cells}) {
        const double at = eye_[axis] + (edge - eye_[axis]) * reach / distance;
        low = std::min(low, at);
        high = std::max(high, at);
      }
    }
    *lo = ClampedPixel(std::ceil(low - 0.5));
    *hi = ClampedPixel(std::ceil(high - 0.5));
  };
  Rect rect;
  range(face_.axis_u, &rect.u0, &rect.u1);
  range(face_.axis_v, &rect.v0, &rect.v1);
  return rect;
}

Rect PerspectivePlanner::CrossingPixels() const {
  const std::array<double, 4> borders = {0, Extent(face_.axis_u), 0, Extent(face_.axis_v)};
  const double reach = std::abs(face_.reference_z - face_.eye[face_.axis_k]);
  // At the eye itself every ray is where the eye is.
  const double near = std::max(face_.near, kLeastPart);
  return Intersect(PixelsBetween(borders, near / reach), PixelsBetween(borders, face_.far / reach));
}

namespace {

/// The pixels `by` times as wide that hold those of `rect`.
Rect Covering(const Rect& rect, int64_t by) {
  const auto down = [by](int64_t a) { return a >= 0 ? a / by : -((-a + by - 1) / by); };
  return {down(rect.u0), down(rect.u1 + by - 1), down(rect.v0), down(rect.v1 + by - 1)};
}

/// Level 0's image: pixels that hold a voxel-wide pixel which the picture sees and whose ray meets
/// the volume. Others would only draw its border into their neighbours.
Rect CoarsestRect(const RetainedSet& retained, const PerspectiveFace& face) {
  const PerspectivePlanner coarsest(retained, face, 0);
  const PerspectivePlanner finest(retained, face, retained.hierarchy().finest());
  return Intersect(coarsest.SeenPixels(),
                   Covering(finest.VolumePixels(), retained.hierarchy().WidthAt(0)));
}

/// The rectangle around what the next level draws, over all slices, in this level's pixels.
Rect ChildBounds(const PerspectiveLevel& level) {
  Rect bounds{kFar, -kFar, kFar, -kFar};
  for (const PerspectiveSlice& slice : level.slices) {
    if (!slice.child.IsEmpty()) {
      bounds = {std::min(bounds.u0, slice.child.u0), std::max(bounds.u1, slice.child.u1),
                std::min(bounds.v0, slice.child.v0), std::max(bounds.v1, slice.child.v1)};
    }
  }
  return bounds;
}

/// The slices of the level below `coarser`: children 2k and 2k+1 use the parent's rectangle.
void AddChildSlices(const PerspectiveLevel& coarser, const PerspectivePlanner& planner,
                    const PerspectiveFace& face, PerspectiveLevel* level) {
  for (const PerspectiveSlice& parent : coarser.slices) {
    for (int i = 0; i < 2 && !parent.child.IsEmpty(); ++i) {
      const int64_t k = 2 * parent.k + (face.ascending ? i : 1 - i);
      if (k >= planner.dims()[face.axis_k]) {
        continue;
      }
      if (auto slice = planner.BareSlice(k)) {
        slice->owned = Doubled(parent.child);
        planner.PlaceWindow(&*slice);
        level->slices.push_back(*slice);
      }
    }
  }
}

/// Frame of a level under `coarser`: its rectangle, borders and crossing pixels.
void PlanBelow(const LevelPlan& coarser, const Rect& bounds, LevelPlan* plan) {
  plan->rect = Doubled(bounds);
  plan->crossing = Intersect(plan->crossing, Doubled(coarser.crossing));
  plan->void_u0 = coarser.void_u0 && bounds.u0 == coarser.rect.u0;
  plan->void_u1 = coarser.void_u1 && bounds.u1 == coarser.rect.u1;
  plan->void_v0 = coarser.void_v0 && bounds.v0 == coarser.rect.v0;
  plan->void_v1 = coarser.void_v1 && bounds.v1 == coarser.rect.v1;
}

}  // namespace

Rect FaceRect(const RetainedSet& retained, const PerspectiveFace& face) {
  const int finest = retained.hierarchy().finest();
  return Intersect(Scaled(CoarsestRect(retained, face), retained.hierarchy().WidthAt(0)),
                   PerspectivePlanner(retained, face, finest).VolumePixels());
}

std::vector<PerspectiveLevel> PlanLevels(const RetainedSet& retained, const PerspectiveFace& face) {
  std::vector<PerspectiveLevel> levels;
  for (int l = 0; l <= retained.hierarchy().finest(); ++l) {
    const PerspectivePlanner planner(retained, face, l);
    PerspectiveLevel level;
    level.plan.level = l;
    level.plan.width = retained.hierarchy().WidthAt(l);
    level.plan.crossing = planner.CrossingPixels();
    if (l == 0) {
      level.plan.rect = CoarsestRect(retained, face);
      if (level.plan.rect.IsEmpty()) {
        break;
      }
      level.slices = planner.BareSlices();
      for (PerspectiveSlice& slice : level.slices) {
        slice.owned = level.plan.rect;
        planner.PlaceWindow(&slice);
      }
    } else {
      const Rect bounds = ChildBounds(levels.back());
      if (bounds.IsEmpty()) {
        break;
      }
      PlanBelow(levels.back().plan, bounds, &level.plan);
      AddChildSlices(levels.back(), planner, face, &level);
    }
    levels.push_back(std::move(level));
  }
  return levels;
}

}  // namespace fovea::render
