#ifndef ENGINE_STORE_REPAIR_TARGET_H_
#define ENGINE_STORE_REPAIR_TARGET_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file.h"

namespace fovea::store {

/// Where a repair writes: over the store itself, or into a folder beside a new one's name, which
/// takes that name at the end. Files are named by their path below the store. Nothing of the store
/// changes, and no new store appears, before Publish. Not thread-safe.
class RepairTarget {
 public:
  /// `output` empty: in place, with the writer's lock. ALREADY_EXISTS if it is there.
  [[nodiscard]] static StatusOr<std::unique_ptr<RepairTarget>> Open(FileSystem& files,
                                                                    const std::string& source,
                                                                    const std::string& output);
  ~RepairTarget();

  [[nodiscard]] bool in_place() const { return folder_ == source_; }
  /// Where the files will be after Publish: a store that can be read once its metadata are there.
  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] std::string PathOf(const std::string& file) const { return folder_ + "/" + file; }
  /// For what is written new, under PathOf.
  [[nodiscard]] FileBatch* batch() { return &batch_; }
  /// Makes a folder unless it is there.
  [[nodiscard]] Status Make(const std::string& folder);
  /// The source's file stands as it is.
  [[nodiscard]] Status Keep(const std::string& file);
  /// The source's file is not to stand.
  void Remove(const std::string& file);
  /// Whether anything is to be written or removed.
  [[nodiscard]] bool Changes() const { return !batch_.empty() || !removed_.empty(); }

  /// What was written appears (the last file last), then what was removed goes.
  [[nodiscard]] Status Publish();
  /// The last call. A new store gets its name.
  [[nodiscard]] Status Finish();

 private:
  RepairTarget(FileSystem& files, std::string source, std::string folder, std::string output)
      : files_(files),
        source_(std::move(source)),
        folder_(std::move(folder)),
        output_(std::move(output)),
        batch_(files) {}

  FileSystem& files_;
  const std::string source_, folder_, output_;
  std::optional<WriterLock> lock_;
  FileBatch batch_;
  std::vector<std::string> made_, removed_;
  bool finished_ = false;
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_REPAIR_TARGET_H_
