#ifndef ENGINE_STORE_REPAIR_SHARD_H_
#define ENGINE_STORE_REPAIR_SHARD_H_

#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file.h"
#include "engine/store/survey.h"

namespace fovea::store {

/// The sound chunks of a shard whose index is gone. A chunk says how long it is, and its checksum
/// whether it is one; where it belongs, chunk_max_W says: if as many were found as the table has,
/// with the same largest |coefficients| in the same order, or else those of which no other one of
/// the shard has the same. Chunks that cannot be placed are not returned. An error only if the file
/// cannot be read.
[[nodiscard]] StatusOr<std::vector<FoundChunk>> FindChunks(FileSystem& files,
                                                           const FoundLevel& level,
                                                           const FoundShard& shard);

/// Writes `chunks` of the shard `from` as the shard at `to`, as they are.
[[nodiscard]] Status CopyChunks(FileSystem& files, const LevelLayout& layout,
                                const std::string& from, std::span<const FoundChunk> chunks,
                                const std::string& to, FileBatch* batch);

}  // namespace fovea::store

#endif  // ENGINE_STORE_REPAIR_SHARD_H_
