#ifndef ENGINE_STORE_STORED_SIZE_H_
#define ENGINE_STORE_STORED_SIZE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"

namespace fovea::store {

/// What one array holds of one step.
struct ArrayBytes {
  std::string array;  // coarse, detail_W or chunk_max_W
  uint64_t bytes = 0;
};

/// How large the files are that hold one committed step of one field, which must both exist:
/// coarse first, then each level and its table from coarse to fine. What lies in files that many
/// steps share (times, statistics) is not counted.
[[nodiscard]] StatusOr<std::vector<ArrayBytes>> StepBytes(const std::string& store_path,
                                                          const DatasetInfo& info,
                                                          const std::string& field, int64_t step);

}  // namespace fovea::store

#endif  // ENGINE_STORE_STORED_SIZE_H_
