#include "service/wire/spec_parts.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

v1::Vec3 ToProto(const Vec3& v) {
  v1::Vec3 proto;
  proto.set_x(v.x);
  proto.set_y(v.y);
  proto.set_z(v.z);
  return proto;
}

StatusOr<Vec3> FromProto(const v1::Vec3& proto, const std::string& path) {
  FOVEA_RETURN_IF_ERROR(CheckFinite(path, {proto.x(), proto.y(), proto.z()}));
  return Vec3{proto.x(), proto.y(), proto.z()};
}

v1::Space SpaceToProto(bool world) {
  return world ? v1::SPACE_WORLD : v1::SPACE_VOXEL;
}

StatusOr<bool> IsWorld(v1::Space space, const std::string& path) {
  if (!v1::Space_IsValid(space)) {
    return UnknownEnum(path, space, "SPACE_VOXEL, SPACE_WORLD");
  }
  return space == v1::SPACE_WORLD;
}

v1::Lighting ToProto(const render::Lighting& lighting) {
  v1::Lighting proto;
  proto.set_ambient(lighting.ambient);
  proto.set_diffuse(lighting.diffuse);
  proto.set_specular(lighting.specular);
  proto.set_shininess(static_cast<uint32_t>(lighting.shininess));
  *proto.mutable_to_light() = ToProto(lighting.to_light);
  return proto;
}

StatusOr<render::Lighting> FromProto(const v1::Lighting& proto, const std::string& path) {
  constexpr uint32_t kMostShininess = 256;
  render::Lighting lighting;
  lighting.enabled = true;
  FOVEA_RETURN_IF_ERROR(CheckFinite(path, {proto.ambient(), proto.diffuse(), proto.specular()}));
  lighting.ambient = proto.has_ambient() ? proto.ambient() : lighting.ambient;
  lighting.diffuse = proto.has_diffuse() ? proto.diffuse() : lighting.diffuse;
  lighting.specular = proto.has_specular() ? proto.specular() : lighting.specular;
  if (proto.shininess() > kMostShininess) {
    return BadField(path + ".shininess", fmt::format("{} is outside its range, 1 to {}",
                                                     proto.shininess(), kMostShininess));
  }
  if (proto.has_shininess()) {
    lighting.shininess = static_cast<int>(proto.shininess());
  }
  FOVEA_ASSIGN_OR_RETURN(lighting.to_light, FromProto(proto.to_light(), path + ".to_light"));
  return lighting;
}

v1::Clip ToProto(const frames::ClipSpec& clip) {
  v1::Clip proto;
  if (clip.box) {
    *proto.mutable_box()->mutable_lower() = ToProto(clip.box->lower);
    *proto.mutable_box()->mutable_upper() = ToProto(clip.box->upper);
    proto.mutable_box()->set_space(SpaceToProto(clip.box->world));
  }
  for (const frames::ClipPlane& plane : clip.planes) {
    v1::Clip::Plane& out = *proto.add_planes();
    *out.mutable_normal() = ToProto(plane.normal);
    out.set_offset(plane.offset);
    out.set_space(SpaceToProto(plane.world));
  }
  return proto;
}

StatusOr<frames::ClipSpec> FromProto(const v1::Clip& proto, const std::string& path) {
  frames::ClipSpec clip;
  if (proto.has_box()) {
    const std::string inner = path + ".box";
    clip.box.emplace();
    FOVEA_ASSIGN_OR_RETURN(clip.box->lower, FromProto(proto.box().lower(), inner + ".lower"));
    FOVEA_ASSIGN_OR_RETURN(clip.box->upper, FromProto(proto.box().upper(), inner + ".upper"));
    FOVEA_ASSIGN_OR_RETURN(clip.box->world, IsWorld(proto.box().space(), inner + ".space"));
  }
  if (proto.planes_size() > render::kMostClipPlanes) {
    return BadField(path + ".planes", fmt::format("{} planes, outside 0 to {}", proto.planes_size(),
                                                  render::kMostClipPlanes));
  }
  for (int i = 0; i < proto.planes_size(); ++i) {
    const v1::Clip::Plane& plane = proto.planes(i);
    const std::string inner = fmt::format("{}.planes[{}]", path, i);
    frames::ClipPlane out;
    FOVEA_ASSIGN_OR_RETURN(out.normal, FromProto(plane.normal(), inner + ".normal"));
    FOVEA_RETURN_IF_ERROR(CheckFinite(inner + ".offset", {plane.offset()}));
    out.offset = plane.offset();
    FOVEA_ASSIGN_OR_RETURN(out.world, IsWorld(plane.space(), inner + ".space"));
    clip.planes.push_back(out);
  }
  return clip;
}

StatusOr<std::optional<render::Compositing>> FromProto(v1::Compositing proto,
                                                       const std::string& path) {
  switch (proto) {
    case v1::COMPOSITING_UNSPECIFIED:
      return std::optional<render::Compositing>();
    case v1::COMPOSITING_EMISSION:
      return std::optional(render::Compositing::kEmissionAbsorption);
    case v1::COMPOSITING_MAXIMUM:
      return std::optional(render::Compositing::kMaximum);
    default:
      return UnknownEnum(path, proto, "COMPOSITING_EMISSION, COMPOSITING_MAXIMUM");
  }
}

v1::Mode ToProto(frames::Mode mode) {
  switch (mode) {
    case frames::Mode::kTwoPhase:
      return v1::MODE_TWO_PHASE;
    case frames::Mode::kFused:
      return v1::MODE_FUSED;
    case frames::Mode::kAuto:
      break;
  }
  return v1::MODE_AUTO;
}

StatusOr<std::optional<frames::Mode>> FromProto(v1::Mode proto, const std::string& path) {
  switch (proto) {
    case v1::MODE_UNSPECIFIED:
      return std::optional<frames::Mode>();
    case v1::MODE_TWO_PHASE:
      return std::optional(frames::Mode::kTwoPhase);
    case v1::MODE_FUSED:
      return std::optional(frames::Mode::kFused);
    case v1::MODE_AUTO:
      return std::optional(frames::Mode::kAuto);
    default:
      return UnknownEnum(path, proto, "MODE_TWO_PHASE, MODE_FUSED, MODE_AUTO");
  }
}

}  // namespace

void OptionsToProto(const frames::FrameSpec& spec, v1::FrameSpec* proto) {
  if (spec.compositing) {
    proto->set_compositing(*spec.compositing == render::Compositing::kMaximum
                               ? v1::COMPOSITING_MAXIMUM
                               : v1::COMPOSITING_EMISSION);
  }
  if (spec.lighting) {
    *proto->mutable_lighting() = ToProto(*spec.lighting);
  }
  if (!spec.clip.IsEmpty()) {
    *proto->mutable_clip() = ToProto(spec.clip);
  }
  if (spec.color_field) {
    proto->set_color_field(*spec.color_field);
  }
  if (spec.color_transfer) {
    *proto->mutable_color_transfer_function() = ToProto(*spec.color_transfer);
  }
  if (spec.mode) {
    proto->set_mode(ToProto(*spec.mode));
  }
}

Status OptionsFromProto(const v1::FrameSpec& proto, const std::string& path,
                        frames::FrameSpec* spec) {
  FOVEA_ASSIGN_OR_RETURN(spec->compositing, FromProto(proto.compositing(), path + ".compositing"));
  FOVEA_ASSIGN_OR_RETURN(spec->mode, FromProto(proto.mode(), path + ".mode"));
  if (proto.has_lighting()) {
    FOVEA_ASSIGN_OR_RETURN(spec->lighting, FromProto(proto.lighting(), path + ".lighting"));
  }
  FOVEA_ASSIGN_OR_RETURN(spec->clip, FromProto(proto.clip(), path + ".clip"));
  if (proto.has_color_field()) {
    spec->color_field = proto.color_field();
  }
  if (proto.has_color_transfer_function()) {
    FOVEA_ASSIGN_OR_RETURN(spec->color_transfer, FromProto(proto.color_transfer_function(),
                                                           path + ".color_transfer_function"));
  }
  return absl::OkStatus();
}

}  // namespace fovea::wire
