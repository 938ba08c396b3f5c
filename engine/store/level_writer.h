#ifndef ENGINE_STORE_LEVEL_WRITER_H_
#define ENGINE_STORE_LEVEL_WRITER_H_

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/volume/brick_grid.h"

namespace fovea::store {

/// Writes one level of detail of one field of one step: its shards, and its table of the largest
/// |coefficient| of each chunk. Chunks of zeros, and shards of such, are not stored. The files
/// appear with `batch`. INVALID_ARGUMENT if a coefficient is not finite.
[[nodiscard]] Status WriteLevel(const std::string& store_path, const std::string& field,
                                int64_t step, const LevelLayout& layout, const BrickGrid& detail,
                                FileBatch* batch);

}  // namespace fovea::store

#endif  // ENGINE_STORE_LEVEL_WRITER_H_
