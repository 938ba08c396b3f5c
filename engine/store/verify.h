#ifndef ENGINE_STORE_VERIFY_H_
#define ENGINE_STORE_VERIFY_H_

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file_system.h"

namespace fovea::store {

struct VerifyReport {
  int64_t steps = 0;
  uint64_t chunks = 0;
  uint64_t bytes = 0;
  /// One line for each thing that is wrong: array, step, chunk, and what about it.
  std::vector<std::string> problems;
  /// By field: the steps that a repair marked as lost, where there are any. No problem, but nothing
  /// is left of them.
  std::map<std::string, std::vector<int64_t>> lost_steps;
};

/// Reads every chunk of every committed step and checks every checksum, length and metadata file.
/// OK with problems listed if the store is damaged; an error only if it cannot be opened at all.
/// `progress(done, total)` is called after each step; return false to stop (CANCELLED).
[[nodiscard]] StatusOr<VerifyReport> Verify(
    const std::string& path, int threads,
    const std::function<bool(int64_t done, int64_t total)>& progress = nullptr,
    FileSystem& files = RealFileSystem());

}  // namespace fovea::store

#endif  // ENGINE_STORE_VERIFY_H_
