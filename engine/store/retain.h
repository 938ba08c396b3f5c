#ifndef ENGINE_STORE_RETAIN_H_
#define ENGINE_STORE_RETAIN_H_

#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/assemble.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"

/// A store cut down to the detail in some windows. Whole chunks stay or go: those that meet a
/// window stay, so that inside the windows nothing is lost. Coarse levels, times, and statistics,
/// which are those of all that once was, stay as they are.
namespace fovea::store {

struct RetainReport {
  int64_t steps = 0;
  CutCounts counts;
};

/// Cuts the store at `path` down. First its `retention` says so; then, step by step, shards and
/// tables are replaced by cut ones or removed. Whoever reads meanwhile gets what is kept, and of
/// what goes the values or zeros, never an error. If it is stopped, by whatever means, the store
/// reads just so, and the same call goes on. INVALID_ARGUMENT, with the store as it was, if the
/// windows reach outside what it retains already; FAILED_PRECONDITION if a writer holds it.
[[nodiscard]] StatusOr<RetainReport> RetainInPlace(const std::string& path,
                                                   const std::vector<RetainedWindow>& windows,
                                                   const StepProgress& progress = nullptr,
                                                   FileSystem& files = RealFileSystem());

/// The same into a new store at `output`; the one at `path` stays. Files that stay whole are linked
/// where the file system can, else copied. All steps are committed at once; if it is stopped
/// before, the same call begins again. ALREADY_EXISTS if `output` is anything else.
[[nodiscard]] StatusOr<RetainReport> RetainCopy(const std::string& path, const std::string& output,
                                                const std::vector<RetainedWindow>& windows,
                                                const StepProgress& progress = nullptr,
                                                FileSystem& files = RealFileSystem());

}  // namespace fovea::store

#endif  // ENGINE_STORE_RETAIN_H_
