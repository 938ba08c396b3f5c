#include <cmath>

#include "service/frames/frames.h"

namespace fovea::frames {
namespace {

/// Messages start with the field's name in the proto, so that callers can point at it.
template <typename T>
Status CheckRange(const char* field, const std::optional<T>& value, T low, T high) {
  // Written so that NaN fails too.
  if (value && !(*value >= low && *value <= high)) {
    return InvalidArgument("{} {} is outside its range, {} to {}", field, *value, low, high);
  }
  return absl::OkStatus();
}

Status CheckFinite(const char* field, const std::optional<double>& value) {
  if (value && !std::isfinite(*value)) {
    return InvalidArgument("{} {} is not a finite number", field, *value);
  }
  return absl::OkStatus();
}

Status CheckRate(const std::optional<Rate>& rate) {
  for (int axis = 0; rate && axis < 3; ++axis) {
    if (!((*rate)[axis] >= 1 && (*rate)[axis] <= kMaxDimension)) {
      return InvalidArgument("rate {} is outside its range, 1 to {}{}", FormatRate(*rate),
                             kMaxDimension, rate->IsIsotropic() ? "" : " along each axis");
    }
  }
  return absl::OkStatus();
}

Status CheckPosition(const char* field, const std::optional<Position>& position) {
  if (!position) {
    return absl::OkStatus();
  }
  for (int axis = 0; axis < 3; ++axis) {
    FOVEA_RETURN_IF_ERROR(CheckFinite(field, position->at[axis]));
  }
  return absl::OkStatus();
}

Status CheckPerspective(const ViewSpec& view) {
  const PerspectiveSpec& perspective = *view.perspective;
  if (view.azimuth_deg || view.elevation_deg || view.center || view.span_voxels) {
    return InvalidArgument(
        "eye: a perspective view has neither azimuth, elevation, center nor span; leave them out");
  }
  FOVEA_RETURN_IF_ERROR(CheckPosition("eye", perspective.eye));
  FOVEA_RETURN_IF_ERROR(CheckPosition("target", perspective.target));
  if (perspective.up) {
    FOVEA_RETURN_IF_ERROR(CheckPosition("up", Position{*perspective.up}));
    if (*perspective.up == Vec3{}) {
      return InvalidArgument("up 0,0,0 has no direction");
    }
  }
  return CheckRange("fov_y_deg", perspective.fov_y_deg, render::kLeastFovDeg, render::kMostFovDeg);
}

Status CheckView(const ViewSpec& view) {
  if (view.perspective) {
    return CheckPerspective(view);
  }
  FOVEA_RETURN_IF_ERROR(CheckFinite("azimuth_deg", view.azimuth_deg));
  FOVEA_RETURN_IF_ERROR(CheckRange("elevation_deg", view.elevation_deg, -90.0, 90.0));
  FOVEA_RETURN_IF_ERROR(CheckPosition("center", view.center));
  FOVEA_RETURN_IF_ERROR(CheckFinite("span_voxels", view.span_voxels));
  if (view.span_voxels && *view.span_voxels <= 0) {
    return InvalidArgument("span_voxels {} is outside its range, above 0", *view.span_voxels);
  }
  return absl::OkStatus();
}

/// The engine's own check of what lights and cuts, among settings that are otherwise fine.
Status CheckLightingAndClip(const FrameSpec& spec) {
  render::RenderSettings settings;
  settings.transfer.points.resize(1);
  settings.lighting = spec.lighting.value_or(render::Lighting{});
  settings.clip = EngineClip(spec.clip);
  return render::Validate(settings);
}

Status CheckCompositing(const FrameSpec& spec) {
  if (spec.compositing != render::Compositing::kMaximum) {
    return absl::OkStatus();
  }
  if (spec.lighting) {
    return InvalidArgument("lighting lights surfaces, and compositing maximum has none; leave one");
  }
  if (spec.weighting && spec.weighting->kind == render::Weighting::Kind::kFalloff) {
    return InvalidArgument("weighting falloff does not go with compositing maximum; leave one");
  }
  return absl::OkStatus();
}

Status CheckColorField(const FrameSpec& spec) {
  if (!spec.color_transfer) {
    return absl::OkStatus();
  }
  if (!spec.color_field) {
    return InvalidArgument("color_transfer_function is given without a color_field to colour by");
  }
  return Annotate(render::Validate(*spec.color_transfer), "color_transfer_function");
}

}  // namespace

render::Clip EngineClip(const ClipSpec& spec) {
  render::Clip clip;
  if (spec.box) {
    clip.box = {spec.box->lower, spec.box->upper};
  }
  for (const ClipPlane& plane : spec.planes) {
    clip.planes.push_back({plane.normal, plane.offset});
  }
  return clip;
}

Status ValidateSpec(const FrameSpec& spec) {
  constexpr int64_t kMaxSide = render::kMaxPicturePixels;
  FOVEA_RETURN_IF_ERROR(CheckView(spec.view));
  FOVEA_RETURN_IF_ERROR(CheckPosition("fovea", spec.fovea));
  FOVEA_RETURN_IF_ERROR(CheckRate(spec.rate));
  FOVEA_RETURN_IF_ERROR(CheckRange("width_px", spec.width_px, int64_t{1}, kMaxSide));
  FOVEA_RETURN_IF_ERROR(CheckRange("height_px", spec.height_px, int64_t{1}, kMaxSide));
  FOVEA_RETURN_IF_ERROR(CheckRange("jpeg_quality", spec.jpeg_quality, int64_t{1}, int64_t{100}));
  if (spec.transfer) {
    FOVEA_RETURN_IF_ERROR(Annotate(render::Validate(*spec.transfer), "transfer_function"));
  }
  if (spec.weighting) {
    const std::optional<double> falloff = spec.weighting->falloff_per_voxel;
    FOVEA_RETURN_IF_ERROR(CheckRange("falloff_per_voxel", falloff, 0.0, 1e6));
  }
  FOVEA_RETURN_IF_ERROR(CheckLightingAndClip(spec));
  FOVEA_RETURN_IF_ERROR(CheckCompositing(spec));
  FOVEA_RETURN_IF_ERROR(CheckColorField(spec));
  if (spec.background) {
    for (const float part : {spec.background->red, spec.background->green, spec.background->blue}) {
      FOVEA_RETURN_IF_ERROR(CheckRange("background", std::optional<float>(part), 0.0F, 1.0F));
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::frames
