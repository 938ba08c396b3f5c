#include "service/export/animation.h"

#include <cmath>
#include <numbers>

#include <nlohmann/json.hpp>

namespace fovea::exports {

using nlohmann::json;

/// Fills an Animation from JSON, key by key.
class AnimationParser {
 public:
  [[nodiscard]] StatusOr<Animation> Parse(const json& root) {
    constexpr int64_t kMaxFrames = 1'000'000;
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
    animation_.frames_ = frames.get<int64_t>();
    if (!root["keys"].is_array() || root["keys"].empty()) {
      return InvalidArgument("\"keys\" must be a list of at least one keyframe");
    }
    for (const json& key : root["keys"]) {
      FOVEA_RETURN_IF_ERROR(AddKey(key));
    }
    const bool orthographic = !animation_.view_.empty() || !animation_.span_.empty();
    const bool perspective = !animation_.eye_.empty() || !animation_.target_.empty() ||
                             !animation_.up_.empty() || !animation_.fov_.empty();
    if (orthographic && perspective) {
      return InvalidArgument(
          "the keys move both an orthographic view (view, span) and a camera (eye, target, up, "
          "fov); a shot has one of them");
    }
    if (perspective && animation_.eye_.empty()) {
      return InvalidArgument(
          "the keys move a camera's target, up or fov but never say \"eye\"; one key with it is "
          "enough");
    }
    return std::move(animation_);
  }

 private:
  Status AddKey(const json& key) {
    if (!key.is_object() || !key.contains("frame") || !key["frame"].is_number_integer()) {
      return InvalidArgument("every keyframe needs a whole number \"frame\"");
    }
    const auto frame = key["frame"].get<int64_t>();
    if (frame <= last_frame_ || frame > animation_.frames_) {
      return InvalidArgument("keyframe \"frame\" {}: they must grow, from 0 to {}", frame,
                             animation_.frames_);
    }
    last_frame_ = frame;
    for (const auto& item : key.items()) {
      const std::string& name = item.key();
      if (name != "frame") {
        FOVEA_RETURN_IF_ERROR(AddValue(frame, name, item.value()));
      }
    }
    return absl::OkStatus();
  }

  Status AddValue(int64_t frame, const std::string& name, const json& value) {
    struct Known {
      const char* name;
      size_t numbers;
      Animation::Track* track;
    };
    const Known known[] = {{"view", 2, &animation_.view_}, {"fovea", 3, &animation_.fovea_},
                           {"rate", 1, &animation_.rate_}, {"span", 1, &animation_.span_},
                           {"eye", 3, &animation_.eye_},   {"target", 3, &animation_.target_},
                           {"up", 3, &animation_.up_},     {"fov", 1, &animation_.fov_},
                           {"step", 1, &animation_.step_}};
    for (const Known& one : known) {
      if (name != one.name) {
        continue;
      }
      Animation::Key key{frame, {}};
      const json list = one.numbers == 1 ? json::array({value}) : value;
      bool good = list.is_array() && list.size() == one.numbers;
      for (size_t i = 0; good && i < one.numbers; ++i) {
        good = list[i].is_number();
        key.value[i] = good ? list[i].get<double>() : 0;
      }
      if (!good || (name == "step" && !value.is_number_unsigned())) {
        return InvalidArgument("keyframe {}: \"{}\" must be {}", frame, name,
                               one.numbers == 1   ? (name == "step" ? "a step, from 0" : "a number")
                               : one.numbers == 2 ? "[azimuth, elevation] in degrees"
                               : name == "up"     ? "[x, y, z] in world axes"
                                                  : "[x, y, z] in voxels");
      }
      one.track->push_back(key);
      return absl::OkStatus();
    }
    return InvalidArgument(
        "keyframe {}: unknown key \"{}\"; there are frame, view, span, eye, target, up, fov, "
        "fovea, "
        "rate and step",
        frame, name);
  }

  Animation animation_;
  int64_t last_frame_ = -1;
};

StatusOr<Animation> Animation::Parse(const std::string& json_text) {
  const json root = json::parse(json_text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded()) {
    return InvalidArgument("not valid JSON");
  }
  return AnimationParser().Parse(root);
}

Animation Animation::Orbit(double azimuth_deg, double elevation_deg, double degrees,
                           int64_t frames) {
  Animation animation;
  animation.frames_ = frames;
  animation.view_ = {{0, {azimuth_deg, elevation_deg}},
                     {frames, {azimuth_deg + degrees, elevation_deg}}};
  return animation;
}

Animation Animation::Orbit(const frames::PerspectiveSpec& camera, const Matrix4& index_to_world,
                           double degrees, int64_t frames) {
  Animation animation;
  animation.frames_ = frames;
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
    const Vec3 eye = to_voxels.TransformPoint(target + turned);
    animation.eye_.push_back({frame, {eye.x, eye.y, eye.z}});
  }
  return animation;
}

std::optional<std::array<double, 3>> Animation::Sample(const Track& track, int64_t frame) {
  if (track.empty()) {
    return std::nullopt;
  }
  size_t next = 0;
  while (next < track.size() && track[next].frame <= frame) {
    ++next;
  }
  if (next == 0 || next == track.size()) {
    return track[next == 0 ? 0 : next - 1].value;
  }
  const Key& a = track[next - 1];
  const Key& b = track[next];
  const double part = static_cast<double>(frame - a.frame) / static_cast<double>(b.frame - a.frame);
  std::array<double, 3> value{};
  for (size_t i = 0; i < value.size(); ++i) {
    value[i] = a.value[i] + part * (b.value[i] - a.value[i]);
  }
  return value;
}

void Animation::MoveCamera(int64_t frame, frames::FrameSpec* spec) const {
  const auto vector = [](const std::array<double, 3>& v) { return Vec3{v[0], v[1], v[2]}; };
  if (const auto eye = Sample(eye_, frame)) {
    const frames::PerspectiveSpec camera =
        spec->view.perspective.value_or(frames::PerspectiveSpec{});
    spec->view = {};
    spec->view.perspective = camera;
    spec->view.perspective->eye = frames::Position{vector(*eye)};
  }
  if (!spec->view.perspective) {
    return;
  }
  if (const auto target = Sample(target_, frame)) {
    spec->view.perspective->target = frames::Position{vector(*target)};
  }
  if (const auto up = Sample(up_, frame)) {
    spec->view.perspective->up = vector(*up);
  }
  if (const auto fov = Sample(fov_, frame)) {
    spec->view.perspective->fov_y_deg = (*fov)[0];
  }
}

frames::FrameSpec Animation::SpecAt(int64_t frame, const frames::FrameSpec& spec) const {
  frames::FrameSpec result = spec;
  if (const auto view = Sample(view_, frame)) {
    result.view.azimuth_deg = (*view)[0];
    result.view.elevation_deg = (*view)[1];
  }
  MoveCamera(frame, &result);
  if (const auto fovea = Sample(fovea_, frame)) {
    result.fovea = frames::Position{{(*fovea)[0], (*fovea)[1], (*fovea)[2]}};
  }
  if (const auto rate = Sample(rate_, frame)) {
    result.rate = (*rate)[0];
  }
  if (const auto span = Sample(span_, frame)) {
    result.view.span_voxels = (*span)[0];
  }
  return result;
}

std::optional<int64_t> Animation::StepAt(int64_t frame) const {
  const auto step = Sample(step_, frame);
  if (!step) {
    return std::nullopt;
  }
  return static_cast<int64_t>(std::floor((*step)[0] + 0.5));
}

}  // namespace fovea::exports
