#ifndef ENGINE_STORE_REMOVAL_H_
#define ENGINE_STORE_REMOVAL_H_

#include <string>
#include <string_view>
#include <utility>

#include "engine/base/status.h"
#include "engine/store/file.h"
#include "engine/store/file_system.h"

namespace fovea::store {

/// The end of a store, in two parts, so that whoever dies on the way leaves all of it or nothing
/// under its name: Begin renames it, Finish removes its files. Between the two it lies beside where
/// it was, under a name that no dataset has (IsRemovedName); TakeUp goes on with what was left so.
/// Not thread-safe.
class StoreRemoval {
 public:
  /// When it returns, nothing is at `path` any more, and a power cut does not bring it back.
  /// FAILED_PRECONDITION, saying who, if another writes to it; NOT_FOUND if nothing is there.
  [[nodiscard]] static StatusOr<StoreRemoval> Begin(const std::string& path,
                                                    FileSystem& files = RealFileSystem());
  /// Of a removal that was interrupted. FAILED_PRECONDITION if it is not: another goes on with it.
  [[nodiscard]] static StatusOr<StoreRemoval> TakeUp(const std::string& path,
                                                     FileSystem& files = RealFileSystem());

  /// Removes all files. May be called again after an error.
  [[nodiscard]] Status Finish();

 private:
  StoreRemoval(FileSystem& files, std::string path, WriterLock lock)
      : files_(&files), path_(std::move(path)), lock_(std::move(lock)) {}

  FileSystem* files_;
  std::string path_;  // where it lies now
  WriterLock lock_;
};

/// Both parts for whoever holds the writer's lock of the store, and lets go of it after that: of a
/// store that was made and came to nothing. Readers find all of it or nothing meanwhile.
[[nodiscard]] Status RemoveHeldStore(const std::string& path, FileSystem& files = RealFileSystem());

/// Whether Begin gives such names to folders.
[[nodiscard]] bool IsRemovedName(std::string_view name);

}  // namespace fovea::store

#endif  // ENGINE_STORE_REMOVAL_H_
