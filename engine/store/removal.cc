#include "engine/store/removal.h"

#include <cerrno>

#include "engine/store/layout.h"

namespace fovea::store {
namespace {

/// Short, whatever the store is called: there is a limit on the length of names.
constexpr std::string_view kPrefix = ".fovea-removed-";
/// Removals in one folder that lie unfinished.
constexpr int kMostAtOnce = 10'000;

/// Renames a store whose lock is held; where it lies then.
StatusOr<std::string> MoveAway(FileSystem& files, const std::string& path) {
  const std::string folder = DirectoryOf(path);
  for (int i = 0; i < kMostAtOnce; ++i) {
    const std::string away = fmt::format("{}/{}{}", folder, kPrefix, i);
    const int renamed = files.Rename(path, away);
    if (renamed == -ENOTEMPTY || renamed == -EEXIST) {
      continue;  // of another removal
    }
    if (renamed < 0) {
      return ErrnoStatus(-renamed, "cannot rename", path);
    }
    FOVEA_RETURN_IF_ERROR(FlushDirectory(files, folder));
    return away;
  }
  return FailedPrecondition("{}/{}0 and what follows are {} stores half removed; remove them",
                            folder, kPrefix, kMostAtOnce);
}

}  // namespace

StatusOr<StoreRemoval> StoreRemoval::Begin(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(WriterLock lock, WriterLock::Take(files, path));
  FOVEA_ASSIGN_OR_RETURN(std::string away, MoveAway(files, path));
  return StoreRemoval(files, std::move(away), std::move(lock));
}

StatusOr<StoreRemoval> StoreRemoval::TakeUp(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(WriterLock lock, WriterLock::Take(files, path));
  return StoreRemoval(files, path, std::move(lock));
}

Status StoreRemoval::Finish() {
  return RemoveTree(*files_, path_);
}

Status RemoveHeldStore(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_ASSIGN_OR_RETURN(const std::string away, MoveAway(files, store));
  return RemoveTree(files, away);
}

bool IsRemovedName(std::string_view name) {
  return name.starts_with(kPrefix);
}

}  // namespace fovea::store
