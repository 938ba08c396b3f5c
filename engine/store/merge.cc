#include "engine/store/merge.h"

#include <algorithm>
#include <charconv>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/metadata.h"

namespace fovea::store {
namespace {

constexpr std::string_view kEnding = ".zarr";

std::string WithoutEnding(const std::string& path) {
  return path.ends_with(kEnding) ? path.substr(0, path.size() - kEnding.size()) : path;
}

std::string FileName(const std::string& path) {
  return path.substr(path.rfind('/') + 1);  // npos + 1 is 0
}

/// Takes "N" off the front of `text`.
std::optional<int64_t> TakeNumber(std::string_view* text) {
  int64_t number = 0;
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), number);
  if (error != std::errc() || number < 0) {
    return std::nullopt;
  }
  text->remove_prefix(static_cast<size_t>(end - text->data()));
  return number;
}

bool TakeText(std::string_view expected, std::string_view* text) {
  if (!text->starts_with(expected)) {
    return false;
  }
  text->remove_prefix(expected.size());
  return true;
}

bool IsPartName(std::string_view name, std::string_view stem) {
  return TakeText(stem, &name) && TakeText(".part-", &name) && TakeNumber(&name) &&
         TakeText("-of-", &name) && TakeNumber(&name) && name == kEnding;
}

}  // namespace

std::string PartPath(const std::string& path, int64_t part, int64_t parts) {
  return fmt::format("{}.part-{}-of-{}{}", WithoutEnding(path), part, parts, kEnding);
}

StatusOr<std::vector<std::string>> FindParts(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  const std::string folder = DirectoryOf(store);
  const std::string prefix = store.substr(0, store.size() - FileName(store).size());
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListDirectory(files, folder));
  std::vector<std::string> found;
  for (const std::string& name : names) {
    if (IsPartName(name, WithoutEnding(FileName(store)))) {
      found.push_back(prefix + name);
    }
  }
  return found;
}

std::string DifferenceInMaking(const DatasetInfo& a, const DatasetInfo& b) {
  const auto made_alike = [](const FieldInfo& x, const FieldInfo& y) {
    FieldInfo other = y;
    other.minimum = x.minimum;
    other.maximum = x.maximum;
    other.max_error = x.max_error;
    other.lost_steps = x.lost_steps;
    return x == other;
  };
  if (a.hierarchy != b.hierarchy || a.origin != b.origin) {
    return "extent";
  }
  if (!(a.index_to_world == b.index_to_world) || a.world_unit != b.world_unit) {
    return "place in the world";
  }
  if (!std::equal(a.fields.begin(), a.fields.end(), b.fields.begin(), b.fields.end(), made_alike) ||
      a.default_field != b.default_field) {
    return "fields";
  }
  return a.format_version != b.format_version ? "format version"
         : a.wavelet != b.wavelet             ? "wavelet"
         : a.chunk_edge != b.chunk_edge       ? "chunk edge"
         : a.clock != b.clock                 ? "clock"
         : a.retention != b.retention         ? "retention"
                                              : "";
}

namespace {

/// One part, or why it is none.
StatusOr<Piece> ReadPart(FileSystem& files, const std::string& store) {
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo info, ReadGroup(files, store));
  if (!info.source) {
    return FailedPrecondition(
        "{} does not say what series it is part of: make parts with `fovea ingest --plan` and "
        "`--from-plan PLAN --shard i/n`",
        store);
  }
  return Piece{store, std::move(info)};
}

Status CheckAlike(const Piece& first, const Piece& other) {
  const SourceInfo& a = *first.info.source;
  const SourceInfo& b = *other.info.source;
  std::string difference;
  if (a.series != b.series || a.steps != b.steps) {
    difference = "the series or plan that they are made of";
  } else if (a.parts != b.parts) {
    difference = fmt::format("how many parts there are, {} and {}", a.parts, b.parts);
  } else {
    difference = DifferenceInMaking(first.info, other.info);
  }
  if (difference.empty()) {
    return absl::OkStatus();
  }
  return InvalidArgument("{} and {} are not parts of one dataset: they differ in {}", first.path,
                         other.path, difference);
}

int64_t PartOf(const Piece& piece) {
  return piece.info.source ? piece.info.source->part : 0;
}

/// Every part once, in order; names all that are missing or not complete.
Status CheckComplete(const std::string& path, std::vector<Piece>* parts) {
  const SourceInfo source = *parts->front().info.source;
  std::sort(parts->begin(), parts->end(),
            [](const Piece& a, const Piece& b) { return PartOf(a) < PartOf(b); });
  std::string problems;
  const auto add = [&](const std::string& text) {
    if (problems.size() < 2000) {
      problems += (problems.empty() ? "" : "; ") + text;
    }
  };
  auto piece = parts->begin();
  for (int64_t part = 0; part < source.parts; ++part) {
    if (piece == parts->end() || PartOf(*piece) != part) {
      add(fmt::format("{} is missing", PartPath(path, part, source.parts)));
      continue;
    }
    const SourceInfo& here = *piece->info.source;
    const int64_t wanted = here.LastStep() - here.FirstStep();
    if (piece->info.committed_steps != wanted) {
      add(fmt::format("{} has {} of {} steps", piece->path, piece->info.committed_steps, wanted));
    }
    const auto next = std::next(piece);
    if (next != parts->end() && PartOf(*next) == part) {
      return InvalidArgument("{} and {} are the same part, {} of {}", piece->path, next->path, part,
                             source.parts);
    }
    piece = next;
  }
  if (!problems.empty()) {
    return FailedPrecondition(
        "{} cannot be merged yet: {}; `fovea ingest --from-plan PLAN "
        "--shard i/{}` makes or ends part i",
        path, problems, source.parts);
  }
  return absl::OkStatus();
}

/// The dataset of all parts, without steps.
DatasetInfo WholeInfo(const DatasetInfo& part) {
  DatasetInfo info = part;
  info.committed_steps = 0;
  info.source->part = 0;
  info.source->parts = 1;
  for (FieldInfo& field : info.fields) {
    field.minimum = field.maximum = field.max_error = 0;
    field.lost_steps.clear();
  }
  return info;
}

/// Whether the store at `path` is the one that is to be made; it may be finished or not.
Status CheckTarget(const std::string& path, const DatasetInfo& there, const DatasetInfo& wanted) {
  const bool is_it = there.source == wanted.source && DifferenceInMaking(there, wanted).empty() &&
                     (there.committed_steps == 0 || there.committed_steps >= wanted.source->steps);
  return is_it ? absl::OkStatus()
               : AlreadyExists(
                     "{} is there already, and is not made of these parts: remove it, or "
                     "name another dataset",
                     path);
}

/// Whether `info` is of a whole series, not of a part, and has all its steps.
bool IsWhole(const DatasetInfo& info) {
  return IsComplete(info) && info.source->parts == 1;
}

/// Whether RemoveParts was stopped when this was all but gone.
bool IsRemnant(FileSystem& files, const std::string& store) {
  const StatusOr<std::vector<std::string>> names = ListDirectory(files, store);
  return absl::IsNotFound(names.status()) ||
         (names.ok() && std::all_of(names->begin(), names->end(),
                                    [](const std::string& name) { return name == kLockName; }));
}

class Merger {
 public:
  Merger(FileSystem& files, const MergeOptions& options, const StepProgress& progress)
      : files_(files), options_(options), progress_(progress) {}

  StatusOr<MergeReport> Run();

 private:
  Status ReadParts();
  Status Join();
  Status RemoveParts();

  FileSystem& files_;
  const MergeOptions& options_;
  const StepProgress& progress_;
  std::string path_;
  StatusOr<DatasetInfo> there_ = Status(absl::StatusCode::kUnknown, "");  // what is at path_
  std::vector<Piece> parts_;
  std::vector<std::string> remnants_;
  MergeReport report_;
};

Status Merger::ReadParts() {
  std::vector<std::string> paths = options_.parts;
  if (paths.empty()) {
    FOVEA_ASSIGN_OR_RETURN(paths, FindParts(path_, files_));
  }
  for (const std::string& path : paths) {
    FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
    StatusOr<Piece> part = ReadPart(files_, store);
    if (part.ok()) {
      parts_.push_back(*std::move(part));
    } else if (there_.ok() && IsWhole(*there_) && IsRemnant(files_, store)) {
      remnants_.push_back(store);
    } else {
      return part.status();
    }
  }
  for (const Piece& part : parts_) {
    FOVEA_RETURN_IF_ERROR(CheckAlike(parts_.front(), part));
  }
  return absl::OkStatus();
}

Status Merger::Join() {
  const DatasetInfo whole = WholeInfo(parts_.front().info);
  std::unique_ptr<DatasetWriter> target;  // holds the lock
  if (there_.ok()) {
    FOVEA_RETURN_IF_ERROR(CheckTarget(path_, *there_, whole));
    FOVEA_ASSIGN_OR_RETURN(target, DatasetWriter::Append(path_, files_));  // sweeps
    report_.was_merged = target->info().committed_steps > 0;
  }
  if (!report_.was_merged) {
    FOVEA_RETURN_IF_ERROR(CheckComplete(path_, &parts_));
    if (target == nullptr) {
      FOVEA_ASSIGN_OR_RETURN(target, DatasetWriter::Create(path_, whole, files_));
    }
    CutCounts counts;
    FOVEA_RETURN_IF_ERROR(Assemble(files_, path_, target->info(), parts_, progress_, &counts));
  }
  report_.steps = whole.source->steps;
  report_.parts = parts_.front().info.source->parts;
  return absl::OkStatus();
}

/// What makes it a part goes last, so that what is left of it is known for one.
Status Merger::RemoveParts() {
  for (const Piece& part : parts_) {
    const std::string group = fmt::format("{}/{}", part.path, kMetadataName);
    FOVEA_ASSIGN_OR_RETURN(const WriterLock lock, WriterLock::Take(files_, part.path));
    FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListDirectory(files_, part.path));
    for (const std::string& name : names) {
      const std::string path = fmt::format("{}/{}", part.path, name);
      if (name == kMetadataName || name == kLockName) {
        continue;
      }
      const bool is_ours = name == kTimePath || name == kFrameNumberPath ||
                           std::any_of(part.info.fields.begin(), part.info.fields.end(),
                                       [&](const FieldInfo& field) { return field.name == name; });
      FOVEA_RETURN_IF_ERROR(is_ours ? RemoveTree(files_, path)
                            : IsTemporaryName(name) || name == kGroupCopyName
                                ? RemoveFile(files_, path)
                                : FailedPrecondition("{} is none of the files of a store: {} was "
                                                     "merged, and not removed",
                                                     path, part.path));
    }
    FOVEA_RETURN_IF_ERROR(FlushDirectory(files_, part.path));
    FOVEA_RETURN_IF_ERROR(RemoveFile(files_, group));
    remnants_.push_back(part.path);
  }
  for (const std::string& remnant : remnants_) {
    if (const Status removed = RemoveTree(files_, remnant); !absl::IsNotFound(removed)) {
      FOVEA_RETURN_IF_ERROR(removed);
      ++report_.parts_removed;
    }
  }
  return absl::OkStatus();
}

StatusOr<MergeReport> Merger::Run() {
  FOVEA_ASSIGN_OR_RETURN(path_, StorePath(options_.path));
  there_ = ReadGroup(files_, path_);
  FOVEA_RETURN_IF_ERROR(ReadParts());
  if (!parts_.empty()) {
    FOVEA_RETURN_IF_ERROR(Join());
  } else if (there_.ok() && IsWhole(*there_)) {
    report_ = {there_->committed_steps, 0, true, 0};
  } else {
    return NotFound("there is no part of {}: parts are named {}", path_,
                    FileName(PartPath(path_, 0, 4)));
  }
  if (options_.remove_parts) {
    FOVEA_RETURN_IF_ERROR(RemoveParts());
  }
  return report_;
}

}  // namespace

StatusOr<MergeReport> Merge(const MergeOptions& options, const StepProgress& progress,
                            FileSystem& files) {
  return Merger(files, options, progress).Run();
}

}  // namespace fovea::store
