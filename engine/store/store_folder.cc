#include "engine/store/store_folder.h"

#include <algorithm>
#include <set>
#include <span>
#include <string_view>

#include "engine/store/metadata.h"

namespace fovea::store {
namespace {

Status WriteText(const std::string& path, std::string_view text, FileBatch* batch) {
  return batch->Write(path, std::as_bytes(std::span(text)));
}

std::string MetadataPath(const std::string& folder) {
  return fmt::format("{}/{}", folder, kMetadataName);
}

/// ALREADY_EXISTS if there is anything below `path` that an unfinished Create does not leave.
Status CheckUnfinished(FileSystem& files, const std::string& path) {
  std::vector<DirectoryEntry> entries;
  if (const int listed = files.List(path, &entries); listed < 0) {
    return ErrnoStatus(-listed, "cannot list", path);
  }
  for (const DirectoryEntry& entry : entries) {
    const std::string inside = fmt::format("{}/{}", path, entry.name);
    if (entry.is_directory) {
      FOVEA_RETURN_IF_ERROR(CheckUnfinished(files, inside));
    } else if (entry.name != kMetadataName && entry.name != kLockName &&
               entry.name != kGroupCopyName && !IsTemporaryName(entry.name)) {
      return AlreadyExists("{} exists and holds {}; choose another name, or remove it first", path,
                           inside);
    }
  }
  return absl::OkStatus();
}

/// Removes what a killed Create left: folders, zarr.json and temporary files. ALREADY_EXISTS,
/// touching nothing, if there is anything else.
Status SweepUnfinished(FileSystem& files, const std::string& path) {
  FOVEA_RETURN_IF_ERROR(CheckUnfinished(files, path));
  std::vector<DirectoryEntry> entries;
  if (const int listed = files.List(path, &entries); listed < 0) {
    return ErrnoStatus(-listed, "cannot list", path);
  }
  for (const DirectoryEntry& entry : entries) {
    const std::string inside = fmt::format("{}/{}", path, entry.name);
    if (entry.name != kLockName) {
      FOVEA_RETURN_IF_ERROR(entry.is_directory ? RemoveTree(files, inside)
                                               : RemoveFile(files, inside));
    }
  }
  return absl::OkStatus();
}

Status WriteGroupCopy(const std::string& path, const DatasetInfo& info, FileBatch* batch) {
  FOVEA_ASSIGN_OR_RETURN(const std::string copy, GroupCopyJson(info));
  return WriteText(fmt::format("{}/{}", path, kGroupCopyName), copy, batch);
}

/// Removes temporary files, and files of steps that are not committed, from one array's folder;
/// cuts the array back to `steps`.
Status SweepArray(FileSystem& files, const std::string& path, const ArraySpec& array,
                  int64_t steps) {
  FOVEA_ASSIGN_OR_RETURN(const int64_t array_steps, ReadArraySteps(files, path, array));
  const std::string folder = path + "/" + array.path;
  if (array_steps < steps) {
    return DataLoss("{} has {} steps, the store {}", folder, array_steps, steps);
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListDirectory(files, folder));
  const int64_t chunk_files = (steps + array.FileSteps() - 1) / array.FileSteps();
  for (const std::string& name : names) {
    const auto indices = ParseChunkName(name, array.shape.size() + 1);
    if (IsTemporaryName(name) || (indices && indices->front() >= chunk_files)) {
      FOVEA_RETURN_IF_ERROR(RemoveFile(files, fmt::format("{}/{}", folder, name)));
    }
  }
  if (array_steps == steps) {
    return absl::OkStatus();
  }
  FileBatch batch(files);
  FOVEA_RETURN_IF_ERROR(WriteText(MetadataPath(folder), ArrayJson(array, steps), &batch));
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  return batch.Publish();
}

Status SweepTemporaryFiles(FileSystem& files, const std::string& folder) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListDirectory(files, folder));
  for (const std::string& name : names) {
    if (IsTemporaryName(name)) {
      FOVEA_RETURN_IF_ERROR(RemoveFile(files, fmt::format("{}/{}", folder, name)));
    }
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<WriterLock> ClaimFolder(FileSystem& files, const std::string& path) {
  if (const Status made = MakeDirectory(files, path); !made.ok() && !absl::IsAlreadyExists(made)) {
    return made;
  }
  const auto exists = [&](std::string_view why) {
    return AlreadyExists("{} exists{}; append to it, choose another name, or remove it first", path,
                         why);
  };
  StatusOr<std::vector<std::string>> names = ListDirectory(files, path);
  if (!names.ok()) {
    return absl::IsFailedPrecondition(names.status()) ? exists(" and is not a folder to write to")
                                                      : names.status();
  }
  // No lock file: not ours. Leave it alone.
  if (!names->empty() && std::find(names->begin(), names->end(), kLockName) == names->end()) {
    return exists("");
  }
  FOVEA_ASSIGN_OR_RETURN(WriterLock lock, WriterLock::Take(files, path));
  // Before anything else in the folder: by the lock file the next one sees that it is ours.
  FOVEA_RETURN_IF_ERROR(FlushDirectory(files, path));
  FOVEA_ASSIGN_OR_RETURN(names, ListDirectory(files, path));
  if (std::find(names->begin(), names->end(), kMetadataName) != names->end()) {
    return exists("");
  }
  FOVEA_RETURN_IF_ERROR(SweepUnfinished(files, path));
  FOVEA_RETURN_IF_ERROR(FlushDirectory(files, DirectoryOf(path)));
  return lock;
}

Status WriteMetadata(const std::string& path, const DatasetInfo& info,
                     const std::vector<ArraySpec>& arrays, FileBatch* batch) {
  for (const ArraySpec& array : arrays) {
    FOVEA_RETURN_IF_ERROR(WriteText(MetadataPath(path + "/" + array.path),
                                    ArrayJson(array, info.committed_steps), batch));
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string group, GroupJson(info));
  return WriteText(MetadataPath(path), group, batch);
}

Status MakeEmptyStore(FileSystem& files, const std::string& path, const DatasetInfo& info) {
  FileBatch batch(files);
  std::set<std::string> made;
  const std::vector<ArraySpec> arrays = AllArrays(info);
  for (const FieldInfo& field : info.fields) {
    FOVEA_RETURN_IF_ERROR(MakeDirectory(files, path + "/" + field.name));
    FOVEA_RETURN_IF_ERROR(
        WriteText(MetadataPath(path + "/" + field.name), FieldGroupJson(), &batch));
  }
  for (const ArraySpec& array : arrays) {
    FOVEA_RETURN_IF_ERROR(MakeDirectory(files, path + "/" + array.path));
  }
  FOVEA_RETURN_IF_ERROR(FlushDirectory(files, path));
  FOVEA_RETURN_IF_ERROR(WriteGroupCopy(path, info, &batch));
  FOVEA_RETURN_IF_ERROR(WriteMetadata(path, info, arrays, &batch));
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  return batch.Publish();
}

Status SweepStore(FileSystem& files, const std::string& path, const DatasetInfo& info) {
  FOVEA_RETURN_IF_ERROR(SweepTemporaryFiles(files, path));
  for (const FieldInfo& field : info.fields) {
    FOVEA_RETURN_IF_ERROR(CheckFieldGroup(files, path, field.name));
    FOVEA_RETURN_IF_ERROR(SweepTemporaryFiles(files, path + "/" + field.name));
  }
  for (const ArraySpec& array : AllArrays(info)) {
    FOVEA_RETURN_IF_ERROR(SweepArray(files, path, array, info.committed_steps));
  }
  if (ReadGroup(files, path, kGroupCopyName).ok()) {
    return absl::OkStatus();
  }
  FileBatch batch(files);  // of a store from before there was one, or it is damaged
  FOVEA_RETURN_IF_ERROR(WriteGroupCopy(path, info, &batch));
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  return batch.Publish();
}

}  // namespace fovea::store
