#ifndef SERVICE_WIRE_PATH_H_
#define SERVICE_WIRE_PATH_H_

#include <string>

#include "engine/base/status.h"
#include "fovea/v1/render.pb.h"
#include "service/wire/requests.h"

namespace fovea::wire {

/// INVALID_ARGUMENT pointing at the field below `path` that is not finite or outside its range, or
/// for keyframes that do not grow or do not go together.
[[nodiscard]] StatusOr<PathRequest> FromProto(const v1::Path& proto, const std::string& path);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_PATH_H_
