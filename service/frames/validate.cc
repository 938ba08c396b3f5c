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

}  // namespace

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
  if (spec.background) {
    for (const float part : {spec.background->red, spec.background->green, spec.background->blue}) {
      FOVEA_RETURN_IF_ERROR(CheckRange("background", std::optional<float>(part), 0.0F, 1.0F));
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::frames
