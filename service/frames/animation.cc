#include "service/frames/animation.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

namespace fovea::frames {
namespace {

using nlohmann::json;

Status CheckKind(const std::vector<Keyframe>& keys) {
  bool orthographic = false, camera = false, eye = false;
  for (const Keyframe& key : keys) {
    orthographic |= key.view.has_value() || key.span_voxels.has_value();
    camera |= key.target || key.up || key.fov_y_deg;
    eye |= key.eye.has_value();
  }
  if (orthographic && (camera || eye)) {
    return InvalidArgument(
        "the keys move both an orthographic view (view, span) and a camera (eye, target, up, "
        "fov); a shot has one of them");
  }
  if (camera && !eye) {
    return InvalidArgument(
        "the keys move a camera's target, up or fov but never say \"eye\"; one key with it is "
        "enough");
  }
  return absl::OkStatus();
}

/// Between `a` and `b`.
double Between(double a, double b, double part) {
  return a + part * (b - a);
}
int64_t Between(int64_t a, int64_t b, double part) {
  return static_cast<int64_t>(
      std::floor(Between(static_cast<double>(a), static_cast<double>(b), part) + 0.5));
}
Vec3 Between(const Vec3& a, const Vec3& b, double part) {
  return {Between(a.x, b.x, part), Between(a.y, b.y, part), Between(a.z, b.z, part)};
}
Keyframe::Angles Between(const Keyframe::Angles& a, const Keyframe::Angles& b, double part) {
  return {Between(a.azimuth_deg, b.azimuth_deg, part),
          Between(a.elevation_deg, b.elevation_deg, part)};
}

/// The numbers of a keyframe's value, if they are so many.
std::optional<std::vector<double>> NumbersOf(const json& value, size_t count) {
  const json list = count == 1 ? json::array({value}) : value;
  if (!list.is_array() || list.size() != count) {
    return std::nullopt;
  }
  std::vector<double> numbers;
  for (const json& number : list) {
    if (!number.is_number()) {
      return std::nullopt;
    }
    numbers.push_back(number.get<double>());
  }
  return numbers;
}

/// What a key of a keyframe is called, and how its value looks.
struct KnownKey {
  const char* name;
  size_t numbers;
  const char* form;
  void (*put)(const std::vector<double>& v, Keyframe* key);
};
constexpr KnownKey kKnownKeys[] = {
    {"view", 2, "[azimuth, elevation] in degrees",
     [](const auto& v, Keyframe* key) {
       key->view = Keyframe::Angles{v[0], v[1]};
     }},
    {"span", 1, "a number", [](const auto& v, Keyframe* key) { key->span_voxels = v[0]; }},
    {"eye", 3, "[x, y, z] in voxels",
     [](const auto& v, Keyframe* key) {
       key->eye = Vec3{v[0], v[1], v[2]};
     }},
    {"target", 3, "[x, y, z] in voxels",
     [](const auto& v, Keyframe* key) {
       key->target = Vec3{v[0], v[1], v[2]};
     }},
    {"up", 3, "[x, y, z] in world axes",
     [](const auto& v, Keyframe* key) {
       key->up = Vec3{v[0], v[1], v[2]};
     }},
    {"fov", 1, "a number", [](const auto& v, Keyframe* key) { key->fov_y_deg = v[0]; }},
    {"fovea", 3, "[x, y, z] in voxels",
     [](const auto& v, Keyframe* key) {
       key->fovea = Vec3{v[0], v[1], v[2]};
     }},
    {"rate", 1, "a number", [](const auto& v, Keyframe* key) { key->rate = v[0]; }},
};

Status AddValue(const std::string& name, const json& value, Keyframe* key) {
  if (name == "step") {
    if (!value.is_number_unsigned() || value > uint64_t{1} << 53) {
      return InvalidArgument("keyframe {}: \"step\" must be a step, from 0", key->frame);
    }
    key->step = value.get<int64_t>();
    return absl::OkStatus();
  }
  for (const KnownKey& known : kKnownKeys) {
    if (name == known.name) {
      const auto numbers = NumbersOf(value, known.numbers);
      if (!numbers) {
        return InvalidArgument("keyframe {}: \"{}\" must be {}", key->frame, name, known.form);
      }
      known.put(*numbers, key);
      return absl::OkStatus();
    }
  }
  return InvalidArgument(
      "keyframe {}: unknown key \"{}\"; there are frame, view, span, eye, target, up, fov, fovea, "
      "rate and step",
      key->frame, name);
}

StatusOr<Keyframe> ParseKey(const json& value) {
  if (!value.is_object() || !value.contains("frame") || !value["frame"].is_number_integer()) {
    return InvalidArgument("every keyframe needs a whole number \"frame\"");
  }
  Keyframe key;
  key.frame = value["frame"].get<int64_t>();
  for (const auto& item : value.items()) {
    if (item.key() != "frame") {
      FOVEA_RETURN_IF_ERROR(AddValue(item.key(), item.value(), &key));
    }
  }
  return key;
}

}  // namespace

StatusOr<Animation> Animation::Make(int64_t frames, std::vector<Keyframe> keys) {
  if (frames < 1 || frames > kMaxFrames) {
    return InvalidArgument("\"frames\" must be a whole number, 1 to {}", kMaxFrames);
  }
  if (keys.empty()) {
    return InvalidArgument("\"keys\" must be a list of at least one keyframe");
  }
  int64_t last = -1;
  for (const Keyframe& key : keys) {
    if (key.frame <= last || key.frame > frames) {
      return InvalidArgument("keyframe \"frame\" {}: they must grow, from 0 to {}", key.frame,
                             frames);
    }
    last = key.frame;
  }
  FOVEA_RETURN_IF_ERROR(CheckKind(keys));
  return Animation(frames, std::move(keys));
}

StatusOr<Animation> Animation::Parse(const std::string& json_text) {
  const json root = json::parse(json_text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded()) {
    return InvalidArgument("not valid JSON");
  }
  if (!root.is_object() || !root.contains("frames") || !root.contains("keys")) {
    return InvalidArgument("an animation is an object with \"frames\" and \"keys\"");
  }
  for (const auto& item : root.items()) {
    if (item.key() != "frames" && item.key() != "keys") {
      return InvalidArgument("unknown key \"{}\"; an animation has \"frames\" and \"keys\"",
                             item.key());
    }
  }
  const json& frames = root["frames"];
  if (!frames.is_number_integer() || frames < 1 || frames > kMaxFrames) {
    return InvalidArgument("\"frames\" must be a whole number, 1 to {}", kMaxFrames);
  }
  if (!root["keys"].is_array()) {
    return InvalidArgument("\"keys\" must be a list of at least one keyframe");
  }
  std::vector<Keyframe> keys;
  for (const json& value : root["keys"]) {
    FOVEA_ASSIGN_OR_RETURN(Keyframe key, ParseKey(value));
    keys.push_back(std::move(key));
  }
  return Make(frames.get<int64_t>(), std::move(keys));
}

Animation Animation::Orbit(double azimuth_deg, double elevation_deg, double degrees,
                           int64_t frames) {
  Keyframe begin, end;
  begin.view = {azimuth_deg, elevation_deg};
  end.frame = frames;
  end.view = {azimuth_deg + degrees, elevation_deg};
  return {frames, {begin, end}};
}

Animation Animation::Orbit(const PerspectiveSpec& camera, const Matrix4& index_to_world,
                           double degrees, int64_t frames) {
  std::vector<Keyframe> keys;
  const Matrix4 to_voxels = index_to_world.Inverse();
  const Vec3 target = index_to_world.TransformPoint(camera.target->at);
  const Vec3 arm = index_to_world.TransformPoint(camera.eye.at) - target;
  const Vec3 axis = (1 / Length(*camera.up)) * *camera.up;
  for (int64_t frame = 0; frame < frames; ++frame) {
    const double angle =
        degrees * std::numbers::pi / 180 * static_cast<double>(frame) / static_cast<double>(frames);
    // Rodrigues' formula.
    const Vec3 turned = std::cos(angle) * arm + std::sin(angle) * Cross(axis, arm) +
                        ((1 - std::cos(angle)) * Dot(axis, arm)) * axis;
    Keyframe& key = keys.emplace_back();
    key.frame = frame;
    key.eye = to_voxels.TransformPoint(target + turned);
  }
  return {frames, std::move(keys)};
}

Animation::Animation(int64_t frames, std::vector<Keyframe> keys)
    : frames_(frames), keys_(std::move(keys)) {
  Fill(&view_);
  Fill(&span_voxels_);
  Fill(&eye_);
  Fill(&target_);
  Fill(&up_);
  Fill(&fov_y_deg_);
  Fill(&fovea_);
  Fill(&rate_);
  Fill(&step_);
}

template <typename T>
void Animation::Fill(Track<T>* track) const {
  for (size_t i = 0; i < keys_.size(); ++i) {
    if ((keys_[i].*track->value).has_value()) {
      track->keys.push_back(i);
    }
  }
}

template <typename T>
std::optional<T> Animation::Sample(const Track<T>& track, int64_t frame) const {
  if (track.keys.empty()) {
    return std::nullopt;
  }
  // The first key after this frame, and the one before it.
  const auto next =
      std::upper_bound(track.keys.begin(), track.keys.end(), frame,
                       [this](int64_t at, size_t key) { return at < keys_[key].frame; });
  if (next == track.keys.begin()) {
    return keys_[*next].*track.value;
  }
  const Keyframe& before = keys_[*std::prev(next)];
  if (next == track.keys.end()) {
    return before.*track.value;
  }
  const Keyframe& after = keys_[*next];
  const double part =
      static_cast<double>(frame - before.frame) / static_cast<double>(after.frame - before.frame);
  return Between(*(before.*track.value), *(after.*track.value), part);
}

void Animation::MoveCamera(int64_t frame, FrameSpec* spec) const {
  if (const auto eye = Sample(eye_, frame)) {
    const PerspectiveSpec camera = spec->view.perspective.value_or(PerspectiveSpec{});
    spec->view = {};
    spec->view.perspective = camera;
    spec->view.perspective->eye = Position{*eye};
  }
  if (!spec->view.perspective) {
    return;
  }
  PerspectiveSpec& camera = *spec->view.perspective;
  if (const auto target = Sample(target_, frame)) {
    camera.target = Position{*target};
  }
  if (const auto up = Sample(up_, frame)) {
    camera.up = up;
  }
  if (const auto fov = Sample(fov_y_deg_, frame)) {
    camera.fov_y_deg = fov;
  }
}

FrameSpec Animation::SpecAt(int64_t frame, const FrameSpec& spec) const {
  FrameSpec result = spec;
  if (const auto view = Sample(view_, frame)) {
    result.view.azimuth_deg = view->azimuth_deg;
    result.view.elevation_deg = view->elevation_deg;
  }
  MoveCamera(frame, &result);
  if (const auto fovea = Sample(fovea_, frame)) {
    result.fovea = Position{*fovea};
  }
  if (const auto rate = Sample(rate_, frame)) {
    result.rate = *rate;
  }
  if (const auto span = Sample(span_voxels_, frame)) {
    result.view.span_voxels = span;
  }
  return result;
}

std::optional<int64_t> Animation::StepAt(int64_t frame) const {
  return Sample(step_, frame);
}

}  // namespace fovea::frames
