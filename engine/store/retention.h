#ifndef ENGINE_STORE_RETENTION_H_
#define ENGINE_STORE_RETENTION_H_

#include <mutex>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/retained_set.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"
#include "engine/volume/geometry.h"

namespace fovea::store {

/// A window to retain, as people ask for it.
struct AskedWindow {
  RetainedWindow window;
  bool in_world = false;  // window.at is in world units, not in voxels
  friend bool operator==(const AskedWindow&, const AskedWindow&) = default;
};

/// The windows in voxels of a dataset that lies as `index_to_world` says.
[[nodiscard]] std::vector<RetainedWindow> InVoxels(const std::vector<AskedWindow>& asked,
                                                   const Matrix4& index_to_world);

/// Which chunks of detail a store keeps: all, or those that meet one of the windows of its
/// `retention`, whole. Immutable after Make.
class RetainedChunks {
 public:
  /// INVALID_ARGUMENT, naming the window, if one of `info.retention` is outside the volume, its
  /// rate is no rate, or there are too many.
  [[nodiscard]] static StatusOr<RetainedChunks> Make(const DatasetInfo& info);

  [[nodiscard]] bool KeepsAll() const { return keeps_all_; }
  /// Whether the chunk at `chunk` of `level` (0: coarsest) is kept.
  [[nodiscard]] bool Keeps(int level, const Int3& chunk) const;
  /// Whether all coefficients of `window`, a box of coefficients of `level`, are kept.
  [[nodiscard]] bool Covers(int level, const Box3& window) const;
  /// Whether all windows of `asked`, a set of the same volume, are kept.
  [[nodiscard]] bool Covers(const RetainedSet& asked) const;
  /// Whether every chunk that `other`, of the same volume, keeps is kept here too.
  [[nodiscard]] bool Covers(const RetainedChunks& other) const;

 private:
  [[nodiscard]] Box3 ChunksOf(const Box3& window) const;

  bool keeps_all_ = true;
  int64_t edge_ = 1;
  int finest_ = 0;
  std::vector<std::vector<Box3>> kept_;  // by level: boxes of chunks
};

/// What the store at a path retains, which may become less while it is read. Thread-safe.
class NewestRetention {
 public:
  /// `info`: as the group was read last.
  NewestRetention(FileSystem& files, std::string store_path, const DatasetInfo& info);
  /// Whether a chunk that is not there, and was, was left out on purpose. Reads the group again if
  /// it was not when that was read last.
  [[nodiscard]] bool WasDropped(int level, const Int3& chunk);

 private:
  FileSystem& files_;
  const std::string path_;
  std::mutex mutex_;
  RetainedChunks retained_;  // guarded by mutex_
};

/// Whether `boxes` together hold all of `box`. A box less one of them is at most six boxes, which
/// the rest must hold.
[[nodiscard]] bool UnionContains(const std::vector<Box3>& boxes, const Box3& box);

}  // namespace fovea::store

#endif  // ENGINE_STORE_RETENTION_H_
