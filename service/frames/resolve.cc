#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/render/defaults.h"
#include "service/frames/default_fovea.h"
#include "service/frames/frames.h"

namespace fovea::frames {
namespace {

constexpr int64_t kSampledSteps = 16;

/// A field's statistics at a few steps spread over the series, first and last included.
struct Sampled {
  std::vector<int64_t> steps;
  std::vector<FieldStats> stats;
};

StatusOr<Sampled> SampleSteps(store::Dataset& dataset, const std::string& field,
                              int64_t committed) {
  Sampled sampled;
  const int64_t count = std::min(committed, kSampledSteps);
  for (int64_t i = 0; i < count; ++i) {
    const int64_t step = count == 1 ? 0 : i * (committed - 1) / (count - 1);
    FOVEA_ASSIGN_OR_RETURN(FieldStats stats, dataset.Stats(step, field));
    sampled.steps.push_back(step);
    sampled.stats.push_back(stats);
  }
  return sampled;
}

/// How much there is to see in a step: the voxels' distances from the background value, summed.
double VisibleMass(const FieldStats& stats, double background) {
  double mass = 0;
  const double bin = (stats.maximum - stats.minimum) / 256;
  for (size_t i = 0; i < stats.histogram.size(); ++i) {
    const double value = stats.minimum + (static_cast<double>(i) + 0.5) * bin;
    // Within half a bin of it is the background itself.
    const double distance = std::abs(value - background);
    mass += distance <= bin ? 0 : distance * static_cast<double>(stats.histogram[i]);
  }
  return mass;
}

/// The middle of the histogram's fullest bin.
double BackgroundOf(const FieldStats& stats) {
  const auto fullest = std::max_element(stats.histogram.begin(), stats.histogram.end());
  const auto index = static_cast<double>(fullest - stats.histogram.begin());
  return stats.minimum + (index + 0.5) * (stats.maximum - stats.minimum) / 256;
}

StatusOr<render::TransferFunction> DefaultTransferOfField(store::Dataset& dataset,
                                                          const std::string& field) {
  const store::DatasetInfo info = dataset.info();
  FOVEA_ASSIGN_OR_RETURN(const Sampled sampled, SampleSteps(dataset, field, info.committed_steps));
  return render::DefaultTransferFunction(sampled.stats, info.hierarchy);
}

/// Of the sampled steps the one with most to see.
size_t FullestOf(const Sampled& sampled) {
  size_t fullest = 0;
  for (size_t i = 1; i < sampled.stats.size(); ++i) {
    const auto mass = [&](size_t which) {
      return VisibleMass(sampled.stats[which], BackgroundOf(sampled.stats[which]));
    };
    fullest = mass(i) > mass(fullest) ? i : fullest;
  }
  return fullest;
}

/// 40, or less where the window around the fovea keeps less.
Rate DefaultRateAt(const store::DatasetInfo& info, const Vec3& fovea) {
  double rate = render::DefaultRate(info.hierarchy);
  for (const store::RetainedWindow& window : info.retention) {
    if (window.at == fovea) {
      rate = std::min({rate, window.rate.x, window.rate.y, window.rate.z});
    }
  }
  return Rate(rate);
}

StatusOr<FrameSpec> DefaultsOfField(store::Dataset& dataset, const std::string& field) {
  const store::DatasetInfo info = dataset.info();
  if (info.committed_steps == 0) {
    return FailedPrecondition("{} has no committed step yet: nothing can be shown of it",
                              dataset.path());
  }
  FOVEA_ASSIGN_OR_RETURN(const Sampled sampled, SampleSteps(dataset, field, info.committed_steps));
  const size_t fullest = FullestOf(sampled);
  const auto anywhere = [](const Vec3&) { return true; };
  FOVEA_ASSIGN_OR_RETURN(
      const Vec3 fovea,
      DefaultFoveaOfStep(dataset, sampled.steps[fullest], field, sampled.stats[fullest], anywhere));

  const render::OrthographicView view =
      render::Resolved({}, info.hierarchy.dims(), info.index_to_world);
  FrameSpec spec;
  spec.field = field;
  spec.view = {
      view.azimuth_deg, view.elevation_deg, Position{*view.center_voxels}, *view.span_voxels, {}};
  spec.fovea = Position{fovea};
  spec.rate = DefaultRateAt(info, fovea);
  spec.window = WindowShape::kCube;
  spec.reconstruction = Reconstruction::kExact;
  spec.transfer = render::DefaultTransferFunction(sampled.stats, info.hierarchy);
  spec.weighting = render::Weighting{};
  spec.smoothing = render::Smoothing::kFull;
  spec.basis = render::Basis::kBilinear;
  spec.compositing = render::Compositing::kEmissionAbsorption;
  spec.mode = Mode::kTwoPhase;
  spec.width_px = 512;
  spec.height_px = 512;
  spec.jpeg_quality = 90;
  spec.background = render::Color{};
  return spec;
}

/// A fovea that nobody chose lies in what the picture shows. `resolved` has all but that.
Status MoveFoveaToShown(store::Dataset& dataset, const store::DatasetInfo& info,
                        FrameSpec* resolved) {
  const Accepts shown = ShownBy(info, *resolved);
  if (shown(resolved->fovea->at)) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const Sampled sampled,
                         SampleSteps(dataset, *resolved->field, info.committed_steps));
  const size_t fullest = FullestOf(sampled);
  FOVEA_ASSIGN_OR_RETURN(const Vec3 fovea,
                         DefaultFoveaOfStep(dataset, sampled.steps[fullest], *resolved->field,
                                            sampled.stats[fullest], shown));
  resolved->fovea = Position{shown(fovea) ? fovea : MiddleOfShown(info, *resolved, shown, fovea)};
  return absl::OkStatus();
}

Status CheckField(const store::DatasetInfo& info, const char* name, const std::string& field) {
  std::string names;
  for (const store::FieldInfo& known : info.fields) {
    if (known.name == field) {
      return absl::OkStatus();
    }
    names += (names.empty() ? "" : ", ") + known.name;
  }
  return NotFound("{} '{}' is not in this dataset; it has: {}", name, field, names);
}

template <typename T>
void TakeDefault(std::optional<T>* value, const std::optional<T>& fallback) {
  if (!*value) {
    *value = fallback;
  }
}

Status CheckInvertible(const char* name, const Matrix4& index_to_world) {
  if (index_to_world.Determinant() == 0) {
    return FailedPrecondition(
        "{} is given in world units, but the dataset's index_to_world has no inverse; give voxels",
        name);
  }
  return absl::OkStatus();
}

Status ToVoxels(const char* name, const Matrix4& index_to_world,
                std::optional<Position>* position) {
  if (!(*position)->world) {
    return absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(CheckInvertible(name, index_to_world));
  *position = Position{index_to_world.Inverse().TransformPoint((*position)->at)};
  return absl::OkStatus();
}

Status ResolveOrthographic(const store::DatasetInfo& info, const ViewSpec& fallback,
                           ViewSpec* view) {
  TakeDefault(&view->azimuth_deg, fallback.azimuth_deg);
  TakeDefault(&view->elevation_deg, fallback.elevation_deg);
  TakeDefault(&view->center, fallback.center);
  TakeDefault(&view->span_voxels, fallback.span_voxels);
  return ToVoxels("center", info.index_to_world, &view->center);
}

Status CheckInside(const Position& given, const Vec3& voxels, const Int3& dims) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(voxels[axis] >= 0 && voxels[axis] <= static_cast<double>(dims[axis]))) {
      const std::string world =
          given.world ? fmt::format(" (world {}, {}, {})", given.at.x, given.at.y, given.at.z) : "";
      return InvalidArgument(
          "fovea {}, {}, {}{} is outside the volume: x 0 to {}, y 0 to {}, z 0 to {} voxels",
          voxels.x, voxels.y, voxels.z, world, dims.x, dims.y, dims.z);
    }
  }
  return absl::OkStatus();
}

/// normal . (M p) >= offset in terms of p. A plane needs no inverse.
ClipPlane PlaneInVoxels(const Vec3& normal, double offset, const Matrix4& m) {
  ClipPlane plane;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 step;
    step[axis] = 1;
    plane.normal[axis] = Dot(normal, m.TransformDirection(step));
  }
  plane.offset = offset - Dot(normal, m.TransformPoint({}));
  return plane;
}

/// Whether boxes along the world's axes are boxes along the dataset's.
bool KeepsBoxes(const Matrix4& m) {
  constexpr double kRounding = 1e-12;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 step;
    step[axis] = 1;
    const Vec3 to = m.TransformDirection(step);
    const double largest = std::max({std::abs(to.x), std::abs(to.y), std::abs(to.z)});
    if (std::abs(to.x) + std::abs(to.y) + std::abs(to.z) > (1 + kRounding) * largest) {
      return false;
    }
  }
  return true;
}

Status BoxToVoxels(const Matrix4& index_to_world, ClipSpec* clip) {
  FOVEA_RETURN_IF_ERROR(CheckInvertible("clip_box", index_to_world));
  const ClipBox box = *clip->box;
  if (KeepsBoxes(index_to_world)) {
    const Matrix4 inverse = index_to_world.Inverse();
    const Vec3 a = inverse.TransformPoint(box.lower);
    const Vec3 b = inverse.TransformPoint(box.upper);
    clip->box = ClipBox{{std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)},
                        {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}};
    return absl::OkStatus();
  }
  if (clip->planes.size() + 6 > render::kMostClipPlanes) {
    return InvalidArgument(
        "clip_box in world units takes the place of all {} planes, as this dataset's axes are not "
        "those of the world; give it in voxels, or no clip planes",
        render::kMostClipPlanes);
  }
  clip->box.reset();
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 normal;
    normal[axis] = 1;
    clip->planes.push_back(PlaneInVoxels(normal, box.lower[axis], index_to_world));
    clip->planes.push_back(PlaneInVoxels(-1 * normal, -box.upper[axis], index_to_world));
  }
  return absl::OkStatus();
}

Status ClipToVoxels(const Matrix4& index_to_world, ClipSpec* clip) {
  for (ClipPlane& plane : clip->planes) {
    if (plane.world) {
      FOVEA_RETURN_IF_ERROR(CheckInvertible("clip_plane", index_to_world));
      plane = PlaneInVoxels(plane.normal, plane.offset, index_to_world);
    }
  }
  return clip->box && clip->box->world ? BoxToVoxels(index_to_world, clip) : absl::OkStatus();
}

/// `spec` has its fields.
Status ResolveMode(const store::DatasetInfo& info, FrameSpec* spec) {
  // Slices are made of Haar coefficients that are floats, and rays run along one axis.
  bool possible = info.wavelet == "haar" && !spec->view.perspective;
  for (const store::FieldInfo& field : info.fields) {
    const bool shown = field.name == spec->field || field.name == spec->color_field;
    possible = possible && (!shown || field.type == "float32" || !field.scales.empty());
  }
  if (spec->mode == Mode::kFused && !possible) {
    return InvalidArgument(
        "mode fused is for orthographic views of Haar coefficients, not of lossless ones, and this "
        "{}; ask "
        "for "
        "two-phase or auto",
        spec->view.perspective
            ? "view is a perspective one"
            : fmt::format("dataset's are {} in {}", info.wavelet, info.TypeOf(*spec->field)));
  }
  if (spec->mode == Mode::kAuto) {
    spec->mode = possible ? Mode::kFused : Mode::kTwoPhase;
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<FrameSpec> DefaultSpec(store::Dataset& dataset) {
  return DefaultsOfField(dataset, dataset.info().default_field);
}

Status ResolveCamera(const store::DatasetInfo& info, PerspectiveSpec* view) {
  const Int3& dims = info.hierarchy.dims();
  const Vec3 middle{static_cast<double>(dims.x) / 2, static_cast<double>(dims.y) / 2,
                    static_cast<double>(dims.z) / 2};
  std::optional<Position> eye = view->eye;
  FOVEA_RETURN_IF_ERROR(ToVoxels("eye", info.index_to_world, &eye));
  view->eye = *eye;
  TakeDefault(&view->target, {Position{middle}});
  FOVEA_RETURN_IF_ERROR(ToVoxels("target", info.index_to_world, &view->target));
  TakeDefault(&view->fov_y_deg, {45.0});
  const render::PerspectiveView given{view->eye.at, view->target->at, view->up, *view->fov_y_deg};
  FOVEA_RETURN_IF_ERROR(render::Validate(given, info.index_to_world));
  view->up = render::UpOf(given, info.index_to_world);
  return absl::OkStatus();
}

StatusOr<FrameSpec> ResolveSpec(store::Dataset& dataset, const FrameSpec& spec,
                                const FrameSpec& defaults) {
  FOVEA_RETURN_IF_ERROR(ValidateSpec(spec));
  const store::DatasetInfo info = dataset.info();
  FrameSpec resolved = spec;
  TakeDefault(&resolved.field, defaults.field);
  FOVEA_RETURN_IF_ERROR(CheckField(info, "field", *resolved.field));
  if (resolved.color_field) {
    FOVEA_RETURN_IF_ERROR(CheckField(info, "color_field", *resolved.color_field));
    if (!resolved.color_transfer) {
      FOVEA_ASSIGN_OR_RETURN(resolved.color_transfer,
                             DefaultTransferOfField(dataset, *resolved.color_field));
    }
  }
  FrameSpec fallback = defaults;
  if (resolved.field != defaults.field && !(spec.fovea && spec.transfer)) {
    FOVEA_ASSIGN_OR_RETURN(fallback, DefaultsOfField(dataset, *resolved.field));
  }
  if (resolved.view.perspective) {
    FOVEA_RETURN_IF_ERROR(ResolveCamera(info, &*resolved.view.perspective));
  } else {
    FOVEA_RETURN_IF_ERROR(ResolveOrthographic(info, fallback.view, &resolved.view));
  }
  TakeDefault(&resolved.fovea, fallback.fovea);
  TakeDefault(&resolved.rate, fallback.rate);
  TakeDefault(&resolved.window, fallback.window);
  TakeDefault(&resolved.reconstruction, fallback.reconstruction);
  TakeDefault(&resolved.transfer, fallback.transfer);
  TakeDefault(&resolved.weighting, fallback.weighting);
  TakeDefault(&resolved.smoothing, fallback.smoothing);
  TakeDefault(&resolved.basis, fallback.basis);
  TakeDefault(&resolved.compositing, fallback.compositing);
  TakeDefault(&resolved.mode, fallback.mode);
  TakeDefault(&resolved.width_px, fallback.width_px);
  TakeDefault(&resolved.height_px, fallback.height_px);
  TakeDefault(&resolved.jpeg_quality, fallback.jpeg_quality);
  TakeDefault(&resolved.background, fallback.background);
  const Position given = *resolved.fovea;
  FOVEA_RETURN_IF_ERROR(ToVoxels("fovea", info.index_to_world, &resolved.fovea));
  FOVEA_RETURN_IF_ERROR(ClipToVoxels(info.index_to_world, &resolved.clip));
  FOVEA_RETURN_IF_ERROR(ResolveMode(info, &resolved));
  if (!spec.fovea) {
    FOVEA_RETURN_IF_ERROR(MoveFoveaToShown(dataset, info, &resolved));
  }
  FOVEA_RETURN_IF_ERROR(CheckInside(given, resolved.fovea->at, info.hierarchy.dims()));
  return resolved;
}

}  // namespace fovea::frames
