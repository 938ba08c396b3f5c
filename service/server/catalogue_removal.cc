#include <algorithm>
#include <filesystem>
#include <system_error>
#include <vector>

#include <spdlog/spdlog.h>

#include "service/server/catalogue.h"

// How a catalogue removes datasets.

namespace fovea::server {
namespace {

namespace fs = std::filesystem;

/// Folders below `root` that removals left, as deep as datasets lie; links are not followed.
std::vector<std::string> UnfinishedRemovals(const std::string& root) {
  constexpr auto kOptions = fs::directory_options::skip_permission_denied;
  std::vector<std::string> found;
  std::error_code error;
  fs::recursive_directory_iterator at(root, kOptions, error);
  for (const fs::recursive_directory_iterator end; !error && at != end; at.increment(error)) {
    std::error_code unknown;
    if (at->symlink_status(unknown).type() != fs::file_type::directory) {
      continue;
    }
    const std::string name = at->path().filename().string();
    if (store::IsRemovedName(name)) {
      found.push_back(at->path().string());
    }
    // Stores have many files, and none of these in them.
    if (name.starts_with('.') || name.ends_with(".zarr") ||
        at.depth() + 1 >= Catalogue::kMaxDepth) {
      at.disable_recursion_pending();
    }
  }
  return found;
}

}  // namespace

Status Catalogue::Remove(const std::string& name) {
  FOVEA_ASSIGN_OR_RETURN(store::StoreRemoval removal, BeginRemoval(name));
  return Annotate(removal.Finish(),
                  fmt::format("dataset '{}' is gone, but not all of its files; the next start of a "
                              "server that takes writes removes them",
                              name));
}

/// When it returns, neither the catalogue nor the disk has the dataset under its name.
StatusOr<store::StoreRemoval> Catalogue::BeginRemoval(const std::string& name) {
  Rescan(/*always=*/true);
  // Nobody looks at the disk before it is forgotten: a store that is made in its place meanwhile,
  // even in the same inode, is found as another.
  const std::lock_guard scan_lock(scan_mutex_);
  FOVEA_ASSIGN_OR_RETURN(const Entry entry, Lookup(name));
  if (entry.dataset == nullptr && !absl::IsDataLoss(entry.error)) {
    return Annotate(entry.error, fmt::format("dataset '{}' is not removed", name));
  }
  if (entry.identity.path != fmt::format("{}/{}.zarr", root_, name)) {
    return FailedPrecondition(
        "dataset '{}' is not removed: it is reached by a symbolic link; remove that, or the "
        "dataset by its own name",
        name);
  }
  auto removal = store::StoreRemoval::Begin(entry.identity.path);
  FOVEA_RETURN_IF_ERROR(
      Annotate(removal.status(), fmt::format("dataset '{}' is not removed", name)));
  if (entry.dataset != nullptr) {
    entry.dataset->MarkGone();
  }
  const std::lock_guard lock(mutex_);
  entries_.erase(name);
  return removal;
}

void Catalogue::FinishRemovals() const {
  for (const std::string& path : UnfinishedRemovals(root_)) {
    auto removal = store::StoreRemoval::TakeUp(path);
    const Status status = removal.ok() ? removal->Finish() : removal.status();
    if (status.ok()) {
      spdlog::info("removed what a removal had left: {}", path);
    } else if (!absl::IsNotFound(status)) {
      spdlog::warn("what a removal left stays: {}", MessageOf(status));
    }
  }
}

}  // namespace fovea::server
