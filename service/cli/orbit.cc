#include "service/cli/orbit.h"

#include <utility>

#include <nlohmann/json.hpp>

namespace fovea::cli {

frames::Animation MakeOrbit(const Orbit& orbit, const frames::FrameSpec& resolved,
                            const Matrix4& index_to_world, const StepRange& steps,
                            int64_t committed_steps) {
  constexpr int64_t kFramesOfOneStep = 120;
  const int64_t last = steps.last.value_or(committed_steps - 1);
  const int64_t shown = (last - steps.first) / steps.stride + 1;
  const int64_t frames = orbit.frames.value_or(shown <= 1 ? kFramesOfOneStep : shown);
  const frames::ViewSpec& view = resolved.view;
  return view.perspective
             ? frames::Animation::Orbit(*view.perspective, index_to_world, orbit.degrees, frames)
             : frames::Animation::Orbit(*view.azimuth_deg, *view.elevation_deg, orbit.degrees,
                                        frames);
}

std::string OrbitJson(const frames::Animation& orbit) {
  nlohmann::json keys = nlohmann::json::array();
  for (const frames::Keyframe& key : orbit.keys()) {
    nlohmann::json one = {{"frame", key.frame}};
    if (key.view) {
      one["view"] = {key.view->azimuth_deg, key.view->elevation_deg};
    }
    if (key.eye) {
      one["eye"] = {key.eye->x, key.eye->y, key.eye->z};
    }
    keys.push_back(std::move(one));
  }
  return nlohmann::json({{"frames", orbit.frames()}, {"keys", keys}}).dump();
}

}  // namespace fovea::cli
