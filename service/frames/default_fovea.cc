#include "service/frames/default_fovea.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "engine/fovea/retained_set.h"
#include "engine/render/defaults.h"
#include "engine/render/perspective_view.h"
#include "engine/render/view.h"
#include "engine/store/retention.h"

namespace fovea::frames {
namespace {

/// The field of datasets of scattered readings that says where values were measured.
constexpr const char* kCoverageField = "coverage";

/// Pixels of the square that stands for any picture.
constexpr int kSquare = 1024;

/// `place`, or the middle of the nearest window that is accepted, if detail is missing at `place`.
StatusOr<Vec3> WhereDetailIs(const store::DatasetInfo& info, const Vec3& place,
                             const Accepts& accepts) {
  if (info.retention.empty()) {
    return place;
  }
  FOVEA_ASSIGN_OR_RETURN(const store::RetainedChunks kept, store::RetainedChunks::Make(info));
  FOVEA_ASSIGN_OR_RETURN(
      const RetainedSet around,
      RetainedSet::Make(info.hierarchy, {place, Rate(render::DefaultRate(info.hierarchy))}));
  Vec3 nearest = place;
  double least = std::numeric_limits<double>::infinity();
  for (const store::RetainedWindow& window : info.retention) {
    const double distance = Length(window.at - place);
    if (distance < least && accepts(window.at)) {
      least = distance;
      nearest = window.at;
    }
  }
  return kept.Covers(around) ? place : nearest;
}

bool IsClipped(const ClipSpec& clip, const Vec3& place) {
  for (int axis = 0; clip.box && axis < 3; ++axis) {
    if (place[axis] < clip.box->lower[axis] || place[axis] > clip.box->upper[axis]) {
      return true;
    }
  }
  return std::any_of(clip.planes.begin(), clip.planes.end(), [&](const ClipPlane& plane) {
    return Dot(plane.normal, place) < plane.offset;
  });
}

std::optional<std::array<double, 2>> PixelOf(const store::DatasetInfo& info, const ViewSpec& view,
                                             const Vec3& place) {
  if (const auto& camera = view.perspective) {
    return render::ProjectToPixel(
        {camera->eye.at, camera->target->at, camera->up, *camera->fov_y_deg}, info.index_to_world,
        kSquare, kSquare, place);
  }
  return render::ProjectToPixel(
      {*view.azimuth_deg, *view.elevation_deg, view.center->at, view.span_voxels},
      info.hierarchy.dims(), info.index_to_world, kSquare, kSquare, place);
}

}  // namespace

StatusOr<Vec3> DefaultFoveaOfStep(store::Dataset& dataset, int64_t step, const std::string& field,
                                  const FieldStats& stats, const Accepts& accepts) {
  const store::DatasetInfo info = dataset.info();
  std::string shown = field;
  FieldStats of_shown = stats;
  if (std::any_of(info.fields.begin(), info.fields.end(),
                  [](const store::FieldInfo& one) { return one.name == kCoverageField; })) {
    FOVEA_ASSIGN_OR_RETURN(const FieldStats coverage, dataset.Stats(step, kCoverageField));
    if (coverage.maximum > 0) {
      shown = kCoverageField;
      of_shown = {};
      of_shown.histogram[0] = 1;  // its background is 0, whatever most voxels have
    }
  }
  FOVEA_ASSIGN_OR_RETURN(const auto source, dataset.OpenStep(step, shown, store::OnDamage::kCount));
  FOVEA_ASSIGN_OR_RETURN(const Vec3 densest, render::DefaultFovea(*source, of_shown, accepts));
  return WhereDetailIs(info, densest, accepts);
}

Accepts ShownBy(const store::DatasetInfo& info, const FrameSpec& resolved) {
  return [&info, &resolved](const Vec3& place) {
    const auto pixel = PixelOf(info, resolved.view, place);
    return !IsClipped(resolved.clip, place) && pixel && (*pixel)[0] >= 0 && (*pixel)[1] >= 0 &&
           (*pixel)[0] <= kSquare && (*pixel)[1] <= kSquare;
  };
}

Vec3 MiddleOfShown(const store::DatasetInfo& info, const FrameSpec& resolved, const Accepts& shown,
                   const Vec3& densest) {
  std::vector<Vec3> places;
  if (const auto& box = resolved.clip.box) {
    places.push_back(0.5 * (box->lower + box->upper));
  }
  places.push_back(resolved.view.perspective ? resolved.view.perspective->target->at
                                             : resolved.view.center->at);
  for (Vec3 place : places) {
    for (int axis = 0; axis < 3; ++axis) {
      place[axis] = std::clamp(place[axis], 0.0, static_cast<double>(info.hierarchy.dims()[axis]));
    }
    if (shown(place)) {
      return place;
    }
  }
  return densest;
}

}  // namespace fovea::frames
