#include "service/wire/path.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "engine/render/perspective_view.h"
#include "service/wire/spec_parts.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr size_t kMaxKeys = frames::Animation::kMaxSentKeys;
constexpr double kMaxRate = 65536;
constexpr double kMaxCoordinate = 1e9;  // voxels

Status CheckWithin(const std::string& path, double value, double least, double most) {
  if (!(value >= least && value <= most)) {
    return BadField(path, fmt::format("{} is outside {} to {}", value, least, most));
  }
  return absl::OkStatus();
}

/// A vector each of whose parts is within +-`most`.
StatusOr<Vec3> TakeVector(const v1::Vec3& proto, const std::string& path, double most) {
  for (const double part : {proto.x(), proto.y(), proto.z()}) {
    FOVEA_RETURN_IF_ERROR(CheckWithin(path, part, -most, most));
  }
  return Vec3{proto.x(), proto.y(), proto.z()};
}

Status TakeView(const v1::Keyframe& proto, const std::string& path, frames::Keyframe* key) {
  if (proto.has_view()) {
    const v1::Keyframe::Angles& view = proto.view();
    FOVEA_RETURN_IF_ERROR(CheckFinite(path + ".view.azimuth_deg", {view.azimuth_deg()}));
    FOVEA_RETURN_IF_ERROR(CheckWithin(path + ".view.elevation_deg", view.elevation_deg(), -90, 90));
    key->view = frames::Keyframe::Angles{view.azimuth_deg(), view.elevation_deg()};
  }
  if (proto.has_span_voxels()) {
    if (!(proto.span_voxels() > 0) || !std::isfinite(proto.span_voxels())) {
      return BadField(path + ".span_voxels",
                      fmt::format("{} is not above 0 and finite", proto.span_voxels()));
    }
    key->span_voxels = proto.span_voxels();
  }
  return absl::OkStatus();
}

Status TakeCamera(const v1::Keyframe& proto, const std::string& path, frames::Keyframe* key) {
  if (proto.has_eye()) {
    FOVEA_ASSIGN_OR_RETURN(key->eye, TakeVector(proto.eye(), path + ".eye", kMaxCoordinate));
  }
  if (proto.has_target()) {
    FOVEA_ASSIGN_OR_RETURN(key->target,
                           TakeVector(proto.target(), path + ".target", kMaxCoordinate));
  }
  if (proto.has_up()) {
    const v1::Vec3& up = proto.up();
    FOVEA_RETURN_IF_ERROR(CheckFinite(path + ".up", {up.x(), up.y(), up.z()}));
    key->up = Vec3{up.x(), up.y(), up.z()};
  }
  if (proto.has_fov_y_deg()) {
    FOVEA_RETURN_IF_ERROR(CheckWithin(path + ".fov_y_deg", proto.fov_y_deg(), render::kLeastFovDeg,
                                      render::kMostFovDeg));
    key->fov_y_deg = proto.fov_y_deg();
  }
  return absl::OkStatus();
}

StatusOr<frames::Keyframe> TakeKey(const v1::Keyframe& proto, const std::string& path) {
  frames::Keyframe key;
  if (proto.frame() > frames::Animation::kMaxFrames) {
    return BadField(path + ".frame", fmt::format("{} is outside 0 to {}", proto.frame(),
                                                 frames::Animation::kMaxFrames));
  }
  key.frame = static_cast<int64_t>(proto.frame());
  FOVEA_RETURN_IF_ERROR(TakeView(proto, path, &key));
  FOVEA_RETURN_IF_ERROR(TakeCamera(proto, path, &key));
  if (proto.has_fovea()) {
    FOVEA_ASSIGN_OR_RETURN(key.fovea, TakeVector(proto.fovea(), path + ".fovea", kMaxCoordinate));
  }
  if (proto.has_rate()) {
    FOVEA_RETURN_IF_ERROR(CheckWithin(path + ".rate", proto.rate(), 1, kMaxRate));
    key.rate = proto.rate();
  }
  if (proto.has_step()) {
    constexpr uint64_t kPastAll = uint64_t{1} << 40;  // past the end of any series
    key.step = static_cast<int64_t>(std::min(proto.step(), kPastAll));
  }
  return key;
}

v1::Vec3 ToProto(const Vec3& vector) {
  v1::Vec3 proto;
  proto.set_x(vector.x);
  proto.set_y(vector.y);
  proto.set_z(vector.z);
  return proto;
}

v1::Keyframe ToProto(const frames::Keyframe& key) {
  v1::Keyframe proto;
  proto.set_frame(static_cast<uint64_t>(key.frame));
  if (key.view) {
    proto.mutable_view()->set_azimuth_deg(key.view->azimuth_deg);
    proto.mutable_view()->set_elevation_deg(key.view->elevation_deg);
  }
  if (key.span_voxels) {
    proto.set_span_voxels(*key.span_voxels);
  }
  if (key.eye) {
    *proto.mutable_eye() = ToProto(*key.eye);
  }
  if (key.target) {
    *proto.mutable_target() = ToProto(*key.target);
  }
  if (key.up) {
    *proto.mutable_up() = ToProto(*key.up);
  }
  if (key.fov_y_deg) {
    proto.set_fov_y_deg(*key.fov_y_deg);
  }
  if (key.fovea) {
    *proto.mutable_fovea() = ToProto(*key.fovea);
  }
  if (key.rate) {
    proto.set_rate(*key.rate);
  }
  if (key.step) {
    proto.set_step(static_cast<uint64_t>(*key.step));
  }
  return proto;
}

/// A value that an error may begin with, and whether a keyframe has it.
struct Spoken {
  std::string_view name;
  bool (*says)(const frames::Keyframe& key);
};
constexpr Spoken kSpoken[] = {
    {"eye", [](const frames::Keyframe& key) { return key.eye.has_value(); }},
    {"target", [](const frames::Keyframe& key) { return key.target.has_value(); }},
    {"up", [](const frames::Keyframe& key) { return key.up.has_value(); }},
    {"fovea", [](const frames::Keyframe& key) { return key.fovea.has_value(); }},
    {"rate", [](const frames::Keyframe& key) { return key.rate.has_value(); }},
};

/// The keyframe that a value at keyframe `key` comes from: itself, or one beside it.
size_t WhoSays(const std::vector<frames::Keyframe>& keys, size_t key,
               bool (*says)(const frames::Keyframe&)) {
  for (size_t i = key; i < keys.size(); ++i) {
    if (says(keys[i])) {
      return i;
    }
  }
  for (size_t i = key; i > 0; --i) {
    if (says(keys[i - 1])) {
      return i - 1;
    }
  }
  return key;
}

}  // namespace

StatusOr<PathRequest> FromProto(const v1::Path& proto, const std::string& path) {
  PathRequest request;
  if (proto.has_frames()) {
    if (proto.frames() < 1 || proto.frames() > frames::Animation::kMaxFrames) {
      return BadField(path + ".frames", fmt::format("{} is outside 1 to {}", proto.frames(),
                                                    frames::Animation::kMaxFrames));
    }
    request.frames = proto.frames();
  }
  if (proto.keys().empty() || proto.keys().size() > static_cast<int>(kMaxKeys)) {
    return BadField(path + ".keys",
                    fmt::format("there are {}, outside 1 to {}", proto.keys_size(), kMaxKeys));
  }
  for (int i = 0; i < proto.keys_size(); ++i) {
    const std::string here = fmt::format("{}.keys[{}]", path, i);
    FOVEA_ASSIGN_OR_RETURN(frames::Keyframe key, TakeKey(proto.keys(i), here));
    if (i > 0 && key.frame <= request.keys.back().frame) {
      return BadField(here + ".frame", fmt::format("{} is not above {}, the one before", key.frame,
                                                   request.keys.back().frame));
    }
    if (request.frames && key.frame > *request.frames) {
      return BadField(here + ".frame",
                      fmt::format("{} is outside 0 to {}, the frames", key.frame, *request.frames));
    }
    request.keys.push_back(std::move(key));
  }
  // What is left to be wrong is about all of them.
  const Status together =
      frames::Animation::Make(frames::Animation::kMaxFrames, request.keys).status();
  return together.ok() ? StatusOr<PathRequest>(std::move(request))
                       : BadField(path + ".keys", MessageOf(together));
}

Status PointAtKeyframe(const Status& status, const frames::Animation& path, size_t key) {
  if (!absl::IsInvalidArgument(status)) {
    return status;
  }
  const std::string_view message = MessageOf(status);
  const std::string_view name =
      message.substr(0, message.find_first_not_of("abcdefghijklmnopqrstuvwxyz_"));
  for (const Spoken& spoken : kSpoken) {
    if (name == spoken.name) {
      return BadField(fmt::format("path.keys[{}].{}", WhoSays(path.keys(), key, spoken.says), name),
                      message);
    }
  }
  return BadField(fmt::format("path.keys[{}]", key), message);
}

v1::Path ToProto(const frames::Animation& animation) {
  v1::Path proto;
  proto.set_frames(static_cast<uint32_t>(animation.frames()));
  for (const frames::Keyframe& key : animation.keys()) {
    *proto.add_keys() = ToProto(key);
  }
  return proto;
}

}  // namespace fovea::wire
