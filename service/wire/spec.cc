#include <cmath>

#include "service/frames/frames.h"
#include "service/wire/convert.h"
#include "service/wire/spec_parts.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr int kMaxTransferPoints = 4096;

v1::Position ToProto(const frames::Position& position) {
  v1::Position proto;
  proto.mutable_at()->set_x(position.at.x);
  proto.mutable_at()->set_y(position.at.y);
  proto.mutable_at()->set_z(position.at.z);
  proto.set_space(position.world ? v1::SPACE_WORLD : v1::SPACE_VOXEL);
  return proto;
}

v1::Color ToProto(const render::Color& color) {
  v1::Color proto;
  proto.set_red(color.red);
  proto.set_green(color.green);
  proto.set_blue(color.blue);
  return proto;
}

render::Color FromProto(const v1::Color& proto) {
  return {proto.red(), proto.green(), proto.blue()};
}

void PerspectiveToProto(const frames::PerspectiveSpec& view, v1::Perspective* proto) {
  *proto->mutable_eye() = ToProto(view.eye);
  if (view.target) {
    *proto->mutable_target() = ToProto(*view.target);
  }
  if (view.up) {
    proto->mutable_up()->set_x(view.up->x);
    proto->mutable_up()->set_y(view.up->y);
    proto->mutable_up()->set_z(view.up->z);
  }
  if (view.fov_y_deg) {
    proto->set_fov_y_deg(*view.fov_y_deg);
  }
}

void ViewToProto(const frames::ViewSpec& view, v1::ViewSpec* proto) {
  if (view.perspective) {
    PerspectiveToProto(*view.perspective, proto->mutable_perspective());
    return;
  }
  v1::Orthographic& orthographic = *proto->mutable_orthographic();
  orthographic.set_azimuth_deg(view.azimuth_deg.value_or(0));
  orthographic.set_elevation_deg(view.elevation_deg.value_or(0));
  if (view.center) {
    *orthographic.mutable_center() = ToProto(*view.center);
  }
  if (view.span_voxels) {
    orthographic.set_span_voxels(*view.span_voxels);
  }
}

v1::Weighting ToProto(const render::Weighting& weighting) {
  v1::Weighting proto;
  switch (weighting.kind) {
    case render::Weighting::Kind::kNone:
      proto.set_kind(v1::Weighting::NONE);
      break;
    case render::Weighting::Kind::kChop:
      proto.set_kind(v1::Weighting::CHOP);
      break;
    case render::Weighting::Kind::kFalloff:
      proto.set_kind(v1::Weighting::FALLOFF);
      proto.set_falloff_per_voxel(weighting.falloff_per_voxel);
      break;
  }
  return proto;
}

v1::Smoothing ToProto(render::Smoothing smoothing) {
  switch (smoothing) {
    case render::Smoothing::kNone:
      return v1::SMOOTHING_NONE;
    case render::Smoothing::kImage:
      return v1::SMOOTHING_IMAGE;
    case render::Smoothing::kFull:
      break;
  }
  return v1::SMOOTHING_FULL;
}

v1::Reconstruction ToProto(Reconstruction how) {
  return how == Reconstruction::kFast ? v1::RECONSTRUCTION_FAST : v1::RECONSTRUCTION_EXACT;
}

v1::Basis ToProto(render::Basis basis) {
  return basis == render::Basis::kBspline ? v1::BASIS_BSPLINE : v1::BASIS_BILINEAR;
}

v1::WindowShape ToProto(WindowShape window) {
  switch (window) {
    case WindowShape::kCube:
      return v1::WINDOW_CUBE;
    case WindowShape::kSphere:
      return v1::WINDOW_SPHERE;
    case WindowShape::kSmooth:
      break;
  }
  return v1::WINDOW_SMOOTH;
}

StatusOr<frames::Position> FromProto(const v1::Position& proto, const std::string& path) {
  FOVEA_RETURN_IF_ERROR(
      CheckFinite(path + ".at", {proto.at().x(), proto.at().y(), proto.at().z()}));
  if (!v1::Space_IsValid(proto.space())) {
    return UnknownEnum(path + ".space", proto.space(), "SPACE_VOXEL, SPACE_WORLD");
  }
  return frames::Position{{proto.at().x(), proto.at().y(), proto.at().z()},
                          proto.space() == v1::SPACE_WORLD};
}

StatusOr<frames::PerspectiveSpec> FromProto(const v1::Perspective& proto, const std::string& path) {
  if (!proto.has_eye()) {
    return BadField(path + ".eye", "is missing: a perspective view is seen from there");
  }
  frames::PerspectiveSpec view;
  FOVEA_ASSIGN_OR_RETURN(view.eye, FromProto(proto.eye(), path + ".eye"));
  if (proto.has_target()) {
    FOVEA_ASSIGN_OR_RETURN(view.target, FromProto(proto.target(), path + ".target"));
  }
  if (proto.has_up()) {
    FOVEA_RETURN_IF_ERROR(
        CheckFinite(path + ".up", {proto.up().x(), proto.up().y(), proto.up().z()}));
    view.up = Vec3{proto.up().x(), proto.up().y(), proto.up().z()};
  }
  if (proto.has_fov_y_deg()) {
    FOVEA_RETURN_IF_ERROR(CheckFinite(path + ".fov_y_deg", {proto.fov_y_deg()}));
    view.fov_y_deg = proto.fov_y_deg();
  }
  return view;
}

StatusOr<frames::ViewSpec> FromProto(const v1::ViewSpec& proto, const std::string& path) {
  frames::ViewSpec view;
  if (proto.has_perspective()) {
    FOVEA_ASSIGN_OR_RETURN(view.perspective, FromProto(proto.perspective(), path + ".perspective"));
    return view;
  }
  if (!proto.has_orthographic()) {
    return view;
  }
  const v1::Orthographic& orthographic = proto.orthographic();
  const std::string inner = path + ".orthographic";
  FOVEA_RETURN_IF_ERROR(CheckFinite(inner + ".azimuth_deg", {orthographic.azimuth_deg()}));
  FOVEA_RETURN_IF_ERROR(CheckFinite(inner + ".elevation_deg", {orthographic.elevation_deg()}));
  view.azimuth_deg = orthographic.azimuth_deg();
  view.elevation_deg = orthographic.elevation_deg();
  if (orthographic.has_center()) {
    FOVEA_ASSIGN_OR_RETURN(view.center, FromProto(orthographic.center(), inner + ".center"));
  }
  if (orthographic.has_span_voxels()) {
    FOVEA_RETURN_IF_ERROR(CheckFinite(inner + ".span_voxels", {orthographic.span_voxels()}));
    view.span_voxels = orthographic.span_voxels();
  }
  return view;
}

StatusOr<render::Weighting> FromProto(const v1::Weighting& proto, const std::string& path) {
  render::Weighting weighting;
  switch (proto.kind()) {
    case v1::Weighting::KIND_UNSPECIFIED:
    case v1::Weighting::NONE:
      break;
    case v1::Weighting::CHOP:
      weighting.kind = render::Weighting::Kind::kChop;
      break;
    case v1::Weighting::FALLOFF:
      weighting.kind = render::Weighting::Kind::kFalloff;
      break;
    default:
      return UnknownEnum(path + ".kind", proto.kind(), "NONE, CHOP, FALLOFF");
  }
  const double falloff = proto.falloff_per_voxel();
  FOVEA_RETURN_IF_ERROR(CheckFinite(path + ".falloff_per_voxel", {falloff}));
  if (falloff != 0 && weighting.kind != render::Weighting::Kind::kFalloff) {
    return BadField(path + ".falloff_per_voxel",
                    fmt::format("{} without kind FALLOFF: only that uses it", falloff));
  }
  weighting.falloff_per_voxel = falloff;
  return weighting;
}

StatusOr<std::optional<render::Smoothing>> FromProto(v1::Smoothing proto, const std::string& path) {
  switch (proto) {
    case v1::SMOOTHING_UNSPECIFIED:
      return std::optional<render::Smoothing>();
    case v1::SMOOTHING_NONE:
      return std::optional(render::Smoothing::kNone);
    case v1::SMOOTHING_IMAGE:
      return std::optional(render::Smoothing::kImage);
    case v1::SMOOTHING_FULL:
      return std::optional(render::Smoothing::kFull);
    default:
      return UnknownEnum(path, proto, "SMOOTHING_NONE, SMOOTHING_IMAGE, SMOOTHING_FULL");
  }
}

StatusOr<std::optional<Reconstruction>> FromProto(v1::Reconstruction proto,
                                                  const std::string& path) {
  switch (proto) {
    case v1::RECONSTRUCTION_UNSPECIFIED:
      return std::optional<Reconstruction>();
    case v1::RECONSTRUCTION_EXACT:
      return std::optional(Reconstruction::kExact);
    case v1::RECONSTRUCTION_FAST:
      return std::optional(Reconstruction::kFast);
    default:
      return UnknownEnum(path, proto, "RECONSTRUCTION_EXACT, RECONSTRUCTION_FAST");
  }
}

StatusOr<std::optional<render::Basis>> FromProto(v1::Basis proto, const std::string& path) {
  switch (proto) {
    case v1::BASIS_UNSPECIFIED:
      return std::optional<render::Basis>();
    case v1::BASIS_BILINEAR:
      return std::optional(render::Basis::kBilinear);
    case v1::BASIS_BSPLINE:
      return std::optional(render::Basis::kBspline);
    default:
      return UnknownEnum(path, proto, "BASIS_BILINEAR, BASIS_BSPLINE");
  }
}

StatusOr<std::optional<WindowShape>> FromProto(v1::WindowShape proto, const std::string& path) {
  switch (proto) {
    case v1::WINDOW_SHAPE_UNSPECIFIED:
      return std::optional<WindowShape>();
    case v1::WINDOW_CUBE:
      return std::optional(WindowShape::kCube);
    case v1::WINDOW_SPHERE:
      return std::optional(WindowShape::kSphere);
    case v1::WINDOW_SMOOTH:
      return std::optional(WindowShape::kSmooth);
    default:
      return UnknownEnum(path, proto, "WINDOW_CUBE, WINDOW_SPHERE, WINDOW_SMOOTH");
  }
}

StatusOr<Rate> RateFromProto(const v1::FrameSpec& proto, const std::string& path) {
  if (proto.has_rate()) {
    return BadField(path + ".rate_xyz", "stands instead of rate, not beside it");
  }
  for (const double rate : {proto.rate_xyz().x(), proto.rate_xyz().y(), proto.rate_xyz().z()}) {
    if (!(rate >= 1 && rate <= kMaxDimension)) {
      return BadField(path + ".rate_xyz",
                      fmt::format("{} is outside its range, 1 to {}", rate, kMaxDimension));
    }
  }
  return Rate(proto.rate_xyz().x(), proto.rate_xyz().y(), proto.rate_xyz().z());
}

/// Messages left out become empty optionals; numbers are checked by ValidateSpec later.
Status ScalarsFromProto(const v1::FrameSpec& proto, const std::string& path,
                        frames::FrameSpec* spec) {
  if (proto.has_field()) {
    spec->field = proto.field();
  }
  if (proto.has_rate()) {
    FOVEA_RETURN_IF_ERROR(CheckFinite(path + ".rate", {proto.rate()}));
    spec->rate = proto.rate();
  }
  if (proto.has_rate_xyz()) {
    FOVEA_ASSIGN_OR_RETURN(spec->rate, RateFromProto(proto, path));
  }
  if (proto.has_width_px()) {
    spec->width_px = proto.width_px();
  }
  if (proto.has_height_px()) {
    spec->height_px = proto.height_px();
  }
  if (proto.has_jpeg_quality()) {
    spec->jpeg_quality = proto.jpeg_quality();
  }
  if (proto.has_background()) {
    const v1::Color& color = proto.background();
    FOVEA_RETURN_IF_ERROR(
        CheckFinite(path + ".background", {color.red(), color.green(), color.blue()}));
    spec->background = FromProto(color);
  }
  spec->fovea_marker = proto.fovea_marker();
  spec->strict = proto.strict();
  FOVEA_ASSIGN_OR_RETURN(spec->encoding, EncodingFromProto(proto.encoding(), path + ".encoding"));
  FOVEA_ASSIGN_OR_RETURN(spec->smoothing, FromProto(proto.smoothing(), path + ".smoothing"));
  FOVEA_ASSIGN_OR_RETURN(spec->basis, FromProto(proto.basis(), path + ".basis"));
  FOVEA_ASSIGN_OR_RETURN(spec->window, FromProto(proto.window(), path + ".window"));
  FOVEA_ASSIGN_OR_RETURN(spec->reconstruction,
                         FromProto(proto.reconstruction(), path + ".reconstruction"));
  return absl::OkStatus();
}

/// Raw frames have a size that is known beforehand.
Status CheckRawSize(const frames::FrameSpec& spec, const std::string& path) {
  const int64_t pixel_bytes = RawPixelBytes(spec.encoding);
  const int64_t width = spec.width_px.value_or(512);
  const int64_t height = spec.height_px.value_or(512);
  if (pixel_bytes * width * height <= kMaxFrameBytes) {
    return absl::OkStatus();
  }
  return BadField(
      fmt::format("{}.{}", path, width >= height ? "width_px" : "height_px"),
      fmt::format("width_px {} x height_px {} at {} bytes a pixel is above the {} bytes "
                  "that a frame may have; ask for PNG or JPEG, or fewer pixels",
                  width, height, pixel_bytes, kMaxFrameBytes));
}

}  // namespace

Status CheckFinite(const std::string& path, std::initializer_list<double> values) {
  for (const double value : values) {
    if (!std::isfinite(value)) {
      return BadField(path, fmt::format("{} is not a finite number", value));
    }
  }
  return absl::OkStatus();
}

Status UnknownEnum(const std::string& path, int value, std::string_view known) {
  return BadField(path, fmt::format("{} is not one of {}", value, known));
}

v1::TransferFunction ToProto(const render::TransferFunction& transfer) {
  v1::TransferFunction proto;
  for (const render::TransferFunction::Point& point : transfer.points) {
    v1::TransferFunction::Point& out = *proto.add_points();
    out.set_value(point.value);
    *out.mutable_color() = ToProto(point.color);
    out.set_opacity(point.opacity);
  }
  return proto;
}

StatusOr<render::TransferFunction> FromProto(const v1::TransferFunction& proto,
                                             const std::string& path) {
  const int count = proto.points_size();
  if (count < 1 || count > kMaxTransferPoints) {
    return BadField(path + ".points",
                    fmt::format("{} points, outside 1 to {}", count, kMaxTransferPoints));
  }
  render::TransferFunction transfer;
  for (int i = 0; i < count; ++i) {
    const v1::TransferFunction::Point& point = proto.points(i);
    FOVEA_RETURN_IF_ERROR(CheckFinite(fmt::format("{}.points[{}]", path, i),
                                      {point.value(), point.opacity(), point.color().red(),
                                       point.color().green(), point.color().blue()}));
    transfer.points.push_back({point.value(), FromProto(point.color()), point.opacity()});
  }
  return transfer;
}

int64_t RawPixelBytes(frames::Encoding encoding) {
  switch (encoding) {
    case frames::Encoding::kRawRgba8:
      return 4;
    case frames::Encoding::kRawRgbaF32:
      return 16;
    case frames::Encoding::kPng:
    case frames::Encoding::kJpeg:
    case frames::Encoding::kFoveated:
      break;
  }
  return 0;
}

v1::Encoding ToProto(frames::Encoding encoding) {
  switch (encoding) {
    case frames::Encoding::kPng:
      break;
    case frames::Encoding::kJpeg:
      return v1::JPEG;
    case frames::Encoding::kRawRgba8:
      return v1::RAW_RGBA8;
    case frames::Encoding::kRawRgbaF32:
      return v1::RAW_RGBA_F32;
    case frames::Encoding::kFoveated:
      return v1::FOVEATED;
  }
  return v1::PNG;
}

StatusOr<frames::Encoding> EncodingFromProto(v1::Encoding proto, std::string_view path) {
  switch (proto) {
    case v1::ENCODING_UNSPECIFIED:
    case v1::PNG:
      return frames::Encoding::kPng;
    case v1::JPEG:
      return frames::Encoding::kJpeg;
    case v1::RAW_RGBA8:
      return frames::Encoding::kRawRgba8;
    case v1::RAW_RGBA_F32:
      return frames::Encoding::kRawRgbaF32;
    case v1::FOVEATED:
      return frames::Encoding::kFoveated;
    default:
      return UnknownEnum(std::string(path), proto, "PNG, JPEG, RAW_RGBA8, RAW_RGBA_F32, FOVEATED");
  }
}

v1::FrameSpec ToProto(const frames::FrameSpec& spec) {
  v1::FrameSpec proto;
  if (spec.field) {
    proto.set_field(*spec.field);
  }
  if (spec.view != frames::ViewSpec{}) {
    ViewToProto(spec.view, proto.mutable_view());
  }
  if (spec.fovea) {
    *proto.mutable_fovea() = ToProto(*spec.fovea);
  }
  if (spec.rate && spec.rate->IsIsotropic()) {
    proto.set_rate(spec.rate->x);
  } else if (spec.rate) {
    proto.mutable_rate_xyz()->set_x(spec.rate->x);
    proto.mutable_rate_xyz()->set_y(spec.rate->y);
    proto.mutable_rate_xyz()->set_z(spec.rate->z);
  }
  if (spec.window) {
    proto.set_window(ToProto(*spec.window));
  }
  if (spec.reconstruction) {
    proto.set_reconstruction(ToProto(*spec.reconstruction));
  }
  if (spec.transfer) {
    *proto.mutable_transfer_function() = ToProto(*spec.transfer);
  }
  if (spec.weighting) {
    *proto.mutable_weighting() = ToProto(*spec.weighting);
  }
  if (spec.smoothing) {
    proto.set_smoothing(ToProto(*spec.smoothing));
  }
  if (spec.basis) {
    proto.set_basis(ToProto(*spec.basis));
  }
  if (spec.width_px) {
    proto.set_width_px(static_cast<uint32_t>(*spec.width_px));
  }
  if (spec.height_px) {
    proto.set_height_px(static_cast<uint32_t>(*spec.height_px));
  }
  OptionsToProto(spec, &proto);
  proto.set_encoding(ToProto(spec.encoding));
  if (spec.jpeg_quality) {
    proto.set_jpeg_quality(static_cast<uint32_t>(*spec.jpeg_quality));
  }
  if (spec.background) {
    *proto.mutable_background() = ToProto(*spec.background);
  }
  proto.set_fovea_marker(spec.fovea_marker);
  proto.set_strict(spec.strict);
  return proto;
}

StatusOr<frames::FrameSpec> FromProto(const v1::FrameSpec& proto, std::string_view path) {
  const std::string prefix(path);
  frames::FrameSpec spec;
  FOVEA_RETURN_IF_ERROR(ScalarsFromProto(proto, prefix, &spec));
  FOVEA_ASSIGN_OR_RETURN(spec.view, FromProto(proto.view(), prefix + ".view"));
  if (proto.has_fovea()) {
    FOVEA_ASSIGN_OR_RETURN(spec.fovea, FromProto(proto.fovea(), prefix + ".fovea"));
  }
  if (proto.has_transfer_function()) {
    FOVEA_ASSIGN_OR_RETURN(spec.transfer,
                           FromProto(proto.transfer_function(), prefix + ".transfer_function"));
  }
  if (proto.has_weighting()) {
    FOVEA_ASSIGN_OR_RETURN(spec.weighting, FromProto(proto.weighting(), prefix + ".weighting"));
  }
  FOVEA_RETURN_IF_ERROR(OptionsFromProto(proto, prefix, &spec));
  FOVEA_RETURN_IF_ERROR(PointAtSpecField(frames::ValidateSpec(spec), prefix));
  FOVEA_RETURN_IF_ERROR(CheckRawSize(spec, prefix));
  return spec;
}

}  // namespace fovea::wire
