#ifndef SERVICE_FRAMES_SPEC_JSON_H_
#define SERVICE_FRAMES_SPEC_JSON_H_

#include <nlohmann/json_fwd.hpp>

#include "service/frames/spec.h"

namespace fovea::frames {

/// The messages of proto/fovea/v1/render.proto as JSON, with the field names of the proto; what is
/// absent in a spec is absent here. A frame comes without its pixels.
[[nodiscard]] nlohmann::json SpecToJson(const FrameSpec& spec);
[[nodiscard]] nlohmann::json FrameToJson(const Frame& frame);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_SPEC_JSON_H_
