#ifndef ENGINE_STORE_STEP_SOURCE_H_
#define ENGINE_STORE_STEP_SOURCE_H_

#include <cstdint>
#include <memory>
#include <string>

#include "engine/store/dataset.h"
#include "engine/store/file_system.h"

namespace fovea::store {

/// The coefficients of one field of one committed step; both must exist.
[[nodiscard]] std::unique_ptr<StepSource> MakeStepSource(FileSystem& files,
                                                         const std::string& store_path,
                                                         const DatasetInfo& info, int64_t step,
                                                         const std::string& field,
                                                         OnDamage on_damage);

}  // namespace fovea::store

#endif  // ENGINE_STORE_STEP_SOURCE_H_
