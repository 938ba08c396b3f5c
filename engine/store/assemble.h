#ifndef ENGINE_STORE_ASSEMBLE_H_
#define ENGINE_STORE_ASSEMBLE_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/chunk_file.h"
#include "engine/store/dataset.h"
#include "engine/store/file.h"
#include "engine/store/file_system.h"
#include "engine/store/layout.h"
#include "engine/store/retention.h"

/// Stores made of the files of other stores, without decoding a coefficient.
namespace fovea::store {

/// `progress(done, total)` in steps; return false to stop (CANCELLED).
using StepProgress = std::function<bool(int64_t done, int64_t total)>;

/// How much detail was kept and dropped.
struct CutCounts {
  uint64_t chunks_kept = 0, chunks_dropped = 0;
  uint64_t bytes_dropped = 0;
};

/// What is to be done about one file.
enum class Cut {
  kKeep,     // as it is
  kReplace,  // by the new file, which is in the batch
  kRemove,   // nothing of it is kept
};

/// Cuts the shard of detail at `from` down to the chunks that are kept; where some are and some are
/// not, adds the new shard to `batch` under the name `to`. Chunks are copied as they are, damaged
/// ones too. DATA_LOSS if its index is damaged.
[[nodiscard]] StatusOr<Cut> CutShard(FileSystem& files, const LevelLayout& layout,
                                     const RetainedChunks& retained, const Int3& shard,
                                     const std::string& from, const std::string& to,
                                     FileBatch* batch, CutCounts* counts);
/// The same for a block of chunk_max_W.
[[nodiscard]] StatusOr<Cut> CutTable(FileSystem& files, const LevelLayout& layout,
                                     const RetainedChunks& retained, const Int3& block,
                                     const std::string& from, const std::string& to,
                                     FileBatch* batch);

/// A store whose steps go into another.
struct Piece {
  std::string path;
  DatasetInfo info;
};

/// Fills the store at `path`, which is described by `info` and has no steps yet, with all steps of
/// `pieces`, one piece after another, and commits them at once: until then it has none. Whole files
/// are linked where the file system can, else copied; what `info.retention` does not keep is left
/// out. The pieces stay as they are. May be stopped anywhere and called again. The caller holds
/// the lock of `path`. DATA_LOSS, naming the file, if something of a piece is damaged or missing.
[[nodiscard]] Status Assemble(FileSystem& files, const std::string& path, const DatasetInfo& info,
                              std::span<const Piece> pieces, const StepProgress& progress,
                              CutCounts* counts);

}  // namespace fovea::store

#endif  // ENGINE_STORE_ASSEMBLE_H_
