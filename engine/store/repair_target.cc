#include "engine/store/repair_target.h"

#include <algorithm>
#include <cstddef>
#include <set>
#include <span>

namespace fovea::store {
namespace {

constexpr int64_t kCopyBytes = 1 << 20;

Status CopyFile(FileSystem& files, const std::string& from, WritableFile* to) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile file, ReadableFile::Open(files, from));
  std::vector<std::byte> bytes(static_cast<size_t>(std::min(kCopyBytes, file.size())));
  for (int64_t at = 0; at < file.size(); at += kCopyBytes) {
    const auto count = static_cast<size_t>(std::min(kCopyBytes, file.size() - at));
    const std::span<std::byte> part = std::span(bytes).first(count);
    FOVEA_RETURN_IF_ERROR(file.ReadAt(at, part));
    FOVEA_RETURN_IF_ERROR(to->Append(part));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::unique_ptr<RepairTarget>> RepairTarget::Open(FileSystem& files,
                                                           const std::string& source,
                                                           const std::string& output) {
  if (output.empty()) {
    std::unique_ptr<RepairTarget> target(new RepairTarget(files, source, source, ""));
    FOVEA_ASSIGN_OR_RETURN(WriterLock lock, WriterLock::Take(files, source));
    target->lock_.emplace(std::move(lock));
    return target;
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string path, StorePath(output));
  if (ListDirectory(files, path).ok() || ReadableFile::Open(files, path).ok()) {
    return AlreadyExists("{} exists; give another name with -o, or remove it first", path);
  }
  const std::string folder = TemporaryName(path);
  std::unique_ptr<RepairTarget> target(new RepairTarget(files, source, folder, path));
  if (ListDirectory(files, folder).ok()) {  // of a repair that was cut off
    FOVEA_ASSIGN_OR_RETURN(const WriterLock lock, WriterLock::Take(files, folder));
    FOVEA_RETURN_IF_ERROR(RemoveTree(files, folder));
  }
  FOVEA_RETURN_IF_ERROR(MakeDirectory(files, folder));
  FOVEA_ASSIGN_OR_RETURN(WriterLock lock, WriterLock::Take(files, folder));
  target->lock_.emplace(std::move(lock));
  target->made_.push_back(folder);
  return target;
}

RepairTarget::~RepairTarget() {
  batch_.Discard();
  if (!in_place() && !finished_) {
    // What stays is removed by the next repair to this name.
    [[maybe_unused]] const Status removed = RemoveTree(files_, folder_);
  }
}

Status RepairTarget::Make(const std::string& folder) {
  const Status made = MakeDirectory(files_, PathOf(folder));
  if (absl::IsAlreadyExists(made)) {
    return absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(made);
  made_.push_back(PathOf(folder));
  return FlushDirectory(files_, DirectoryOf(PathOf(folder)));
}

Status RepairTarget::Keep(const std::string& file) {
  if (in_place()) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(WritableFile copy, batch_.Start(PathOf(file)));
  return CopyFile(files_, source_ + "/" + file, &copy);
}

void RepairTarget::Remove(const std::string& file) {
  if (in_place()) {
    removed_.push_back(PathOf(file));
  }
}

Status RepairTarget::Publish() {
  FOVEA_RETURN_IF_ERROR(batch_.Flush());
  FOVEA_RETURN_IF_ERROR(batch_.Publish());
  std::set<std::string> directories;
  for (const std::string& path : removed_) {
    if (const Status removed = RemoveFile(files_, path); !absl::IsNotFound(removed)) {
      FOVEA_RETURN_IF_ERROR(removed);
    }
    directories.insert(DirectoryOf(path));
  }
  removed_.clear();
  for (const std::string& directory : directories) {
    FOVEA_RETURN_IF_ERROR(FlushDirectory(files_, directory));
  }
  return absl::OkStatus();
}

Status RepairTarget::Finish() {
  finished_ = true;
  if (in_place()) {
    return absl::OkStatus();
  }
  for (const std::string& directory : made_) {
    FOVEA_RETURN_IF_ERROR(FlushDirectory(files_, directory));
  }
  if (const int renamed = files_.Rename(folder_, output_); renamed < 0) {
    finished_ = false;
    return ErrnoStatus(-renamed, "cannot rename to", output_);
  }
  return FlushDirectory(files_, DirectoryOf(output_));
}

}  // namespace fovea::store
