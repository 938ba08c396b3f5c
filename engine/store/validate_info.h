#ifndef ENGINE_STORE_VALIDATE_INFO_H_
#define ENGINE_STORE_VALIDATE_INFO_H_

#include "engine/base/status.h"
#include "engine/store/dataset.h"

namespace fovea::store {

/// Whether a store could be described so; INVALID_ARGUMENT naming what could not.
[[nodiscard]] Status ValidateInfo(const DatasetInfo& info);

}  // namespace fovea::store

#endif  // ENGINE_STORE_VALIDATE_INFO_H_
