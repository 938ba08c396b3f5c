#include "engine/store/retain.h"

#include <algorithm>
#include <map>
#include <memory>
#include <span>
#include <utility>

#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/merge.h"
#include "engine/store/metadata.h"
#include "engine/store/retention.h"

namespace fovea::store {
namespace {

/// `info` with these windows, which must lie inside what it retains.
StatusOr<DatasetInfo> WithRetention(const std::string& path, const DatasetInfo& info,
                                    const std::vector<RetainedWindow>& windows) {
  if (windows.empty()) {
    return InvalidArgument("there is no window to retain (--retain)");
  }
  FOVEA_ASSIGN_OR_RETURN(const RetainedChunks before, RetainedChunks::Make(info));
  DatasetInfo after = info;
  after.retention = windows;
  FOVEA_ASSIGN_OR_RETURN(const RetainedChunks kept, RetainedChunks::Make(after));
  if (!before.Covers(kept)) {
    return InvalidArgument(
        "the windows reach outside what {} retains (`fovea info` lists it): what was dropped "
        "cannot be had back",
        path);
  }
  return after;
}

/// The files of one array of detail or of its tables, by step: their positions in space.
using FilesByStep = std::map<int64_t, std::vector<Int3>>;

class Cutter {
 public:
  Cutter(FileSystem& files, std::string path, const DatasetInfo& info,
         const RetainedChunks& retained, RetainReport* report)
      : files_(files), path_(std::move(path)), info_(info), retained_(retained), report_(report) {}

  /// Lists what there is.
  [[nodiscard]] Status Begin();
  [[nodiscard]] Status CutStep(int64_t step);

 private:
  struct Level {
    LevelLayout layout;
    std::string folder;
    bool is_detail = false;  // else tables
    FilesByStep files;
  };
  [[nodiscard]] Status AddLevel(const LevelLayout& layout, const ArraySpec& array, bool is_detail);

  FileSystem& files_;
  const std::string path_;
  const DatasetInfo& info_;
  const RetainedChunks& retained_;
  RetainReport* report_;
  std::vector<Level> levels_;
};

Status Cutter::AddLevel(const LevelLayout& layout, const ArraySpec& array, bool is_detail) {
  Level level{layout, fmt::format("{}/{}", path_, array.path), is_detail, {}};
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListDirectory(files_, level.folder));
  for (const std::string& name : names) {
    const auto indices = ParseChunkName(name, array.shape.size() + 1);
    if (indices && indices->front() < info_.committed_steps) {
      const size_t last = indices->size() - 1;
      level.files[indices->front()].push_back(
          {(*indices)[last], (*indices)[last - 1], (*indices)[last - 2]});
    }
  }
  levels_.push_back(std::move(level));
  return absl::OkStatus();
}

Status Cutter::Begin() {
  for (const ArraySpec& array : AllArrays(info_)) {
    for (const FieldInfo& field : info_.fields) {
      for (int i = 0; i < info_.hierarchy.finest(); ++i) {
        const LevelLayout layout = LevelLayout::Make(info_, field, i);
        const bool is_detail = array.path == DetailPath(field.name, layout.width);
        if (is_detail || array.path == TablePath(field.name, layout.width)) {
          FOVEA_RETURN_IF_ERROR(AddLevel(layout, array, is_detail));
        }
      }
    }
  }
  return absl::OkStatus();
}

Status Cutter::CutStep(int64_t step) {
  FileBatch batch(files_);
  std::vector<std::string> removed;
  for (Level& level : levels_) {
    for (const Int3& at : level.files[step]) {
      const std::string file =
          fmt::format("{}/{}", level.folder, SpaceChunkName(step, at, level.is_detail));
      FOVEA_ASSIGN_OR_RETURN(
          const Cut cut,
          level.is_detail
              ? CutShard(files_, level.layout, retained_, at, file, file, &batch, &report_->counts)
              : CutTable(files_, level.layout, retained_, at, file, file, &batch));
      if (cut == Cut::kRemove) {
        removed.push_back(file);
      }
    }
    level.files.erase(step);
  }
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  FOVEA_RETURN_IF_ERROR(batch.Publish());
  for (const std::string& file : removed) {
    FOVEA_RETURN_IF_ERROR(RemoveFile(files_, file));
  }
  return absl::OkStatus();
}

/// From here on readers know what may be missing.
Status Announce(FileSystem& files, const std::string& path, const DatasetInfo& info) {
  FOVEA_ASSIGN_OR_RETURN(const std::string group, GroupJson(info));
  FOVEA_ASSIGN_OR_RETURN(const std::string copy, GroupCopyJson(info));
  FileBatch batch(files);
  FOVEA_RETURN_IF_ERROR(
      batch.Write(fmt::format("{}/{}", path, kGroupCopyName), std::as_bytes(std::span(copy))));
  FOVEA_RETURN_IF_ERROR(
      batch.Write(fmt::format("{}/{}", path, kMetadataName), std::as_bytes(std::span(group))));
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  return batch.Publish();
}

}  // namespace

StatusOr<RetainReport> RetainInPlace(const std::string& path,
                                     const std::vector<RetainedWindow>& windows,
                                     const StepProgress& progress, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo info, ReadGroup(files, store));
  FOVEA_RETURN_IF_ERROR(WithRetention(store, info, windows).status());  // before anything is done
  // Holds the lock, and has swept up behind a writer or a retain that was stopped.
  FOVEA_ASSIGN_OR_RETURN(const auto lock, DatasetWriter::Append(store, files));
  FOVEA_ASSIGN_OR_RETURN(info, WithRetention(store, lock->info(), windows));
  FOVEA_ASSIGN_OR_RETURN(const RetainedChunks retained, RetainedChunks::Make(info));
  if (lock->info().retention != windows) {
    FOVEA_RETURN_IF_ERROR(Announce(files, store, info));
  }
  RetainReport report;
  Cutter cutter(files, store, info, retained, &report);
  FOVEA_RETURN_IF_ERROR(cutter.Begin());
  while (report.steps < info.committed_steps) {
    if (progress && !progress(report.steps, info.committed_steps)) {
      return Cancelled(
          "stopped: {} of {} steps of {} were cut down, and the others may be read as they were; "
          "the same command goes on",
          report.steps, info.committed_steps, store);
    }
    FOVEA_RETURN_IF_ERROR(
        Annotate(cutter.CutStep(report.steps), fmt::format("step {} of {}", report.steps, store)));
    ++report.steps;
  }
  return report;
}

StatusOr<RetainReport> RetainCopy(const std::string& path, const std::string& output,
                                  const std::vector<RetainedWindow>& windows,
                                  const StepProgress& progress, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_ASSIGN_OR_RETURN(const std::string target, StorePath(output));
  FOVEA_ASSIGN_OR_RETURN(const DatasetInfo info, ReadGroup(files, store));
  FOVEA_ASSIGN_OR_RETURN(const DatasetInfo wanted, WithRetention(store, info, windows));
  const StatusOr<DatasetInfo> there = ReadGroup(files, target);
  if (there.ok() && (there->committed_steps > 0 || !DifferenceInMaking(*there, wanted).empty())) {
    return AlreadyExists("{} is there already: remove it, or name another dataset (-o)", target);
  }
  FOVEA_ASSIGN_OR_RETURN(const auto writer, there.ok()
                                                ? DatasetWriter::Append(target, files)
                                                : DatasetWriter::Create(target, wanted, files));
  RetainReport report;
  const std::vector<Piece> pieces = {{store, info}};
  FOVEA_RETURN_IF_ERROR(Assemble(files, target, writer->info(), pieces, progress, &report.counts));
  report.steps = info.committed_steps;
  return report;
}

}  // namespace fovea::store
