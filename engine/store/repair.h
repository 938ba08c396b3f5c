#ifndef ENGINE_STORE_REPAIR_H_
#define ENGINE_STORE_REPAIR_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file_system.h"

namespace fovea::store {

struct RepairReport {
  int64_t steps = 0;
  uint64_t chunks_kept = 0;  // of detail
  /// One line for each thing that is gone: field, step, level, chunk, and what stands there now.
  std::vector<std::string> lost;
  /// One line for each thing that was damaged and is whole again, and from what.
  std::vector<std::string> rebuilt;
};

struct RepairOptions {
  std::string output;  // a new store, which must not exist yet; empty: in place
  int threads = 0;     // 0: all
};

/// Makes a store of all that is sound in the one at `path`, so that Verify finds nothing wrong in
/// it (docs/formats/store.md, "Repair"). OK whatever was lost: the report says it.
///
/// `before` is called with the whole report before anything is changed in place, or before the new
/// store appears; return false to leave all as it is (CANCELLED). `progress(done, total)` is
/// called after each step, with the same meaning. Whoever dies on the way leaves the sound chunks
/// where they were; run it again.
///
/// FAILED_PRECONDITION if a writer is at work (in place), if the store's metadata and their copy
/// are both gone, or if almost nothing is left; ALREADY_EXISTS if `output` is there. An error of
/// the disk that is not damage (no permission, no descriptors, no space) ends it.
[[nodiscard]] StatusOr<RepairReport> Repair(
    const std::string& path, const RepairOptions& options,
    const std::function<bool(const RepairReport&)>& before = nullptr,
    const std::function<bool(int64_t done, int64_t total)>& progress = nullptr,
    FileSystem& files = RealFileSystem());

}  // namespace fovea::store

#endif  // ENGINE_STORE_REPAIR_H_
