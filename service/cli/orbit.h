#ifndef SERVICE_CLI_ORBIT_H_
#define SERVICE_CLI_ORBIT_H_

#include <cstdint>
#include <optional>
#include <string>

#include "engine/volume/geometry.h"
#include "service/cli/values.h"
#include "service/frames/animation.h"
#include "service/frames/spec.h"

namespace fovea::cli {

/// --orbit and --orbit-frames.
struct Orbit {
  double degrees = 0;
  std::optional<int64_t> frames;  // default: one a step, or 120 of a single step
};

/// The turn of `resolved`, a spec with nothing left to default, over these steps of a dataset with
/// so many committed ones.
[[nodiscard]] frames::Animation MakeOrbit(const Orbit& orbit, const frames::FrameSpec& resolved,
                                          const Matrix4& index_to_world, const StepRange& steps,
                                          int64_t committed_steps);
/// An orbit in the form that Animation::Parse reads.
[[nodiscard]] std::string OrbitJson(const frames::Animation& orbit);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_ORBIT_H_
