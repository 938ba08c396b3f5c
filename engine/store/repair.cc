#include "engine/store/repair.h"

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <utility>

#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/metadata.h"
#include "engine/store/repair_series.h"
#include "engine/store/repair_shard.h"
#include "engine/store/repair_target.h"
#include "engine/store/survey.h"

// In place as into a new store, everything that will be different is written beside what is there
// first; then the caller hears what was lost; then files are renamed, the coefficients' first, the
// group's zarr.json last; what must go is removed after that. Cut off anywhere, what was sound is
// where it was, and the repair can be made again.

namespace fovea::store {
namespace {

/// A store of which so many steps are gone has lost its files, not some of its bytes.
constexpr int64_t kMaxMissingSteps = 50'000;

bool IsDamage(const Status& status) {
  return absl::IsDataLoss(status) || absl::IsNotFound(status);
}

std::string At(const Int3& chunk) {
  return fmt::format("{},{},{} (x, y, z)", chunk.x, chunk.y, chunk.z);
}

class Repairer final : public SurveyVisitor {
 public:
  Repairer(FileSystem& files, std::string path, RepairTarget* target)
      : files_(files), path_(std::move(path)), target_(target), series_(files, path_, target) {}

  /// What the store is, from its group or from the copy of that.
  [[nodiscard]] Status FindInfo();
  /// Coefficients and tables.
  [[nodiscard]] Status Coefficients(int threads, const std::function<bool(int64_t, int64_t)>& go);
  [[nodiscard]] Status Series() { return series_.Look(info_, &report_); }
  [[nodiscard]] Status Metadata();
  [[nodiscard]] bool Changes() const {
    return target_->Changes() || series_.Changes() || group_changes_;
  }
  /// Once the coefficients are where they will be: rows, then the group.
  [[nodiscard]] Status WriteRest();
  [[nodiscard]] const RepairReport& report() const { return report_; }

  void OnStep(FoundStep& found) override;
  void OnShard(FoundStep& found, FoundLevel& level, FoundShard& shard) override;
  void OnLevelEnd(FoundStep& found, FoundLevel& level) override;

 private:
  [[nodiscard]] Status ListFiles(Survey* survey);
  [[nodiscard]] Status StepsFromArrays();
  [[nodiscard]] bool IsWhole(int64_t step) const;
  [[nodiscard]] Status Shard(const FoundStep& found, FoundLevel* level, const FoundShard& shard);
  [[nodiscard]] Status Tables(const FoundStep& found, const FoundLevel& level);
  /// The first error of a visit ends the repair.
  void Note(const Status& status) { status_.Update(status); }
  [[nodiscard]] std::string FileOf(const std::string& path) const {
    return path.substr(path_.size() + 1);
  }

  FileSystem& files_;
  const std::string path_;
  RepairTarget* const target_;
  SeriesRepair series_;
  DatasetInfo info_;
  bool group_changes_ = false;
  RepairReport report_;
  Status status_;
  // The level in hand: its table as it will be, and the blocks that are not as they were.
  std::map<Position, std::vector<float>> table_;
  std::set<Position> changed_blocks_;
};

/// Whether every field of a step is there, its rows apart.
bool Repairer::IsWhole(int64_t step) const {
  return std::all_of(info_.fields.begin(), info_.fields.end(), [&](const FieldInfo& field) {
    const std::string path = fmt::format("{}/{}/{}", path_, CoarsePath(field.name),
                                         SpaceChunkName(step, {0, 0, 0}, /*with_bands=*/false));
    return ReadableFile::Open(files_, path).ok();
  });
}

/// How many steps there are, when the group that said it is gone.
Status Repairer::StepsFromArrays() {
  int64_t steps = kMaxSteps;
  for (const ArraySpec& array : AllArrays(info_)) {
    if (const StatusOr<int64_t> here = ReadArraySteps(files_, path_, array); here.ok()) {
      steps = std::min(steps, *here);
    }
  }
  if (steps == kMaxSteps) {
    return FailedPrecondition("{} cannot be repaired: neither its {} nor that of any array is left",
                              path_, kMetadataName);
  }
  if (steps > 0 && !IsWhole(steps - 1)) {
    --steps;
    report_.lost.push_back(fmt::format(
        "step {}: not all of it is there; perhaps it was never committed. Left out", steps));
  }
  info_.committed_steps = steps;
  for (FieldInfo& field : info_.fields) {
    FOVEA_ASSIGN_OR_RETURN(field, series_.Range(field, steps));
    field.max_error = field.tolerance;  // what was found is gone; what was promised is not
  }
  return absl::OkStatus();
}

Status Repairer::FindInfo() {
  StatusOr<DatasetInfo> info = ReadGroup(files_, path_);
  if (info.ok()) {
    info_ = *std::move(info);
    return absl::OkStatus();
  }
  const std::string group = fmt::format("{}/{}", path_, kMetadataName);
  const bool is_gone = absl::IsNotFound(ReadableFile::Open(files_, group).status());
  if (!absl::IsDataLoss(info.status()) && !is_gone) {
    return info.status();
  }
  StatusOr<DatasetInfo> copy = ReadGroup(files_, path_, kGroupCopyName);
  if (!copy.ok()) {
    return FailedPrecondition(
        "{}; nor is there a sound copy of it ({}): without one of them nobody knows the wavelet, "
        "the size and the place of the volume. Put back the {} of a store that was made from the "
        "same input with the same flags, and repair again",
        MessageOf(info.status()), kGroupCopyName, kMetadataName);
  }
  info_ = *std::move(copy);
  group_changes_ = true;
  FOVEA_RETURN_IF_ERROR(StepsFromArrays());
  report_.rebuilt.push_back(
      fmt::format("{}: from its copy {}, with the {} steps that the arrays have", kMetadataName,
                  kGroupCopyName, info_.committed_steps));
  return absl::OkStatus();
}

Status Repairer::ListFiles(Survey* survey) {
  for (const FieldInfo& field : info_.fields) {
    FOVEA_RETURN_IF_ERROR(target_->Make(field.name));
  }
  for (const ArraySpec& array : AllArrays(info_)) {
    std::vector<std::string> stray;
    const Status listed = survey->List(array, &stray);
    if (!listed.ok() && !absl::IsNotFound(listed)) {
      return listed;
    }
    FOVEA_RETURN_IF_ERROR(target_->Make(array.path));
    for (const std::string& path : stray) {
      target_->Remove(FileOf(path));
      report_.rebuilt.push_back(fmt::format("{}: removed; it lay outside its array", FileOf(path)));
    }
  }
  if (info_.committed_steps - survey->steps_with_files() > kMaxMissingSteps) {
    return FailedPrecondition("{} says that it has {} steps, and there are files of {} only", path_,
                              info_.committed_steps, survey->steps_with_files());
  }
  return absl::OkStatus();
}

Status Repairer::Coefficients(int threads, const std::function<bool(int64_t, int64_t)>& go) {
  report_.steps = info_.committed_steps;
  Survey survey(files_, path_, info_, threads);
  FOVEA_RETURN_IF_ERROR(ListFiles(&survey));
  for (int64_t step = 0; step < info_.committed_steps;) {
    const int64_t end = std::min(info_.committed_steps, step + survey.StepsAtOnce(step));
    survey.Read(step, end, this);
    FOVEA_RETURN_IF_ERROR(status_);
    for (; step < end; ++step) {
      if (go && !go(step + 1, info_.committed_steps)) {
        return Cancelled("stopped after {} of {} steps of {}; nothing was changed", step + 1,
                         info_.committed_steps, path_);
      }
    }
  }
  return absl::OkStatus();
}

void Repairer::OnStep(FoundStep& found) {
  const std::string file = FileOf(found.coarse_path);
  if (found.lost) {
    if (!absl::IsNotFound(found.coarse)) {
      target_->Remove(file);
    }
    return;
  }
  if (found.coarse.ok()) {
    Note(target_->Keep(file));
    return;
  }
  if (!IsDamage(found.coarse)) {
    Note(found.coarse);
    return;
  }
  found.lost = true;
  group_changes_ = true;
  const auto field = std::find_if(info_.fields.begin(), info_.fields.end(),
                                  [&](const FieldInfo& f) { return f.name == found.field; });
  field->lost_steps.insert(
      std::lower_bound(field->lost_steps.begin(), field->lost_steps.end(), found.step), found.step);
  report_.lost.push_back(fmt::format(
      "step {} of '{}': all of it, because its coarse level {}; it is marked as lost and reads as "
      "zeros",
      found.step, found.field, absl::IsNotFound(found.coarse) ? "is missing" : "is damaged"));
  if (!absl::IsNotFound(found.coarse)) {
    target_->Remove(file);
  }
}

/// Whether the table does not say either what the shard held.
bool IsUnknown(const FoundLevel& level, const FoundShard& shard) {
  const auto places = static_cast<size_t>(level.layout.shard_chunks.Product());
  for (size_t place = 0; place < places; ++place) {
    const Int3 at = level.layout.ChunkInShard(shard.shard, place);
    if (level.damaged_blocks.contains(level.BlockOf(at))) {
      return true;
    }
  }
  return false;
}

Status Repairer::Shard(const FoundStep& found, FoundLevel* level, const FoundShard& shard) {
  const LevelLayout& layout = level->layout;
  const std::string file = FileOf(shard.path);
  std::vector<FoundChunk> sound;
  auto bytes = ShardIndexBytes(static_cast<size_t>(layout.shard_chunks.Product()));
  bool as_it_is = shard.status.ok();
  if (!shard.status.ok()) {
    if (!IsDamage(shard.status)) {
      return shard.status;
    }
    FOVEA_ASSIGN_OR_RETURN(sound, FindChunks(files_, *level, shard));
    if (!sound.empty()) {
      report_.rebuilt.push_back(
          fmt::format("{}: its index, from {} chunks found in it", file, sound.size()));
    }
    if (IsUnknown(*level, shard)) {
      report_.lost.push_back(fmt::format(
          "{}: chunks of step {}, nobody knows how many: its index is damaged, and so is {}; their "
          "parents stand there",
          file, found.step, TablePath(found.field, layout.width)));
    }
  }
  for (const FoundChunk& chunk : shard.chunks) {
    bytes += static_cast<int64_t>(chunk.entry.bytes);
    if (chunk.status.ok() && chunk.largest > 0) {
      sound.push_back(chunk);
      continue;
    }
    if (!chunk.status.ok() && !IsDamage(chunk.status)) {
      return chunk.status;
    }
    as_it_is = false;
    changed_blocks_.insert(level->BlockOf(chunk.at));
    if (!chunk.status.ok()) {
      report_.lost.push_back(fmt::format("{}: chunk {} of step {}; its parents stand there", file,
                                         At(chunk.at), found.step));
    }
    level->Forget(chunk.at);
  }
  for (const FoundChunk& chunk : sound) {
    const Position block = level->BlockOf(chunk.at);
    std::vector<float>& values = table_[block];
    values.resize(static_cast<size_t>(layout.table_edge.Product()));
    values[layout.IndexInTable(chunk.at)] = chunk.largest;
    if (level->Largest(chunk.at) != chunk.largest && changed_blocks_.insert(block).second &&
        !level->damaged_blocks.contains(block)) {
      report_.rebuilt.push_back(fmt::format("{}: what {} says of it, from its chunks", file,
                                            TablePath(found.field, layout.width)));
    }
    level->Forget(chunk.at);
  }
  report_.chunks_kept += sound.size();
  if (as_it_is && bytes == shard.file_bytes) {
    return target_->Keep(file);
  }
  if (sound.empty()) {
    target_->Remove(file);
    return absl::OkStatus();
  }
  return CopyChunks(files_, layout, shard.path, sound, target_->PathOf(file), target_->batch());
}

void Repairer::OnShard(FoundStep& found, FoundLevel& level, FoundShard& shard) {
  if (!status_.ok()) {
    return;
  }
  if (found.lost) {
    target_->Remove(FileOf(shard.path));
    return;
  }
  Note(Shard(found, &level, shard));
}

Status Repairer::Tables(const FoundStep& found, const FoundLevel& level) {
  const std::string folder = TablePath(found.field, level.layout.width);
  const auto file_of = [&](const Position& at) {
    return fmt::format("{}/{}", folder,
                       SpaceChunkName(found.step, {at[2], at[1], at[0]}, /*with_bands=*/false));
  };
  for (const auto& [block, status] : level.damaged_blocks) {
    if (!IsDamage(status)) {
      return status;
    }
    changed_blocks_.insert(block);
    report_.rebuilt.push_back(fmt::format("{}: from the chunks that are there", file_of(block)));
  }
  for (const auto& [block, values] : level.table) {
    if (!changed_blocks_.contains(block)) {
      FOVEA_RETURN_IF_ERROR(target_->Keep(file_of(block)));
    }
  }
  Encoder encoder;
  for (const Position& block : changed_blocks_) {
    const auto now = table_.find(block);
    if (now == table_.end()) {
      target_->Remove(file_of(block));
      continue;
    }
    FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded,
                           encoder.Encode(std::as_bytes(std::span(now->second))));
    FOVEA_RETURN_IF_ERROR(target_->batch()->Write(target_->PathOf(file_of(block)), encoded));
  }
  return absl::OkStatus();
}

void Repairer::OnLevelEnd(FoundStep& found, FoundLevel& level) {
  const std::string folder = DetailPath(found.field, level.layout.width);
  if (status_.ok() && found.lost) {
    for (const auto& [block, values] : level.table) {
      changed_blocks_.insert(block);
    }
  } else if (status_.ok()) {
    for (const Int3& at : level.Chunks()) {
      changed_blocks_.insert(level.BlockOf(at));
      report_.lost.push_back(
          fmt::format("{}: chunk {} of step {}, which is missing; its parents "
                      "stand there",
                      folder, At(at), found.step));
    }
  }
  if (status_.ok()) {
    Note(Tables(found, level));
  }
  table_.clear();
  changed_blocks_.clear();
}

Status Repairer::Metadata() {
  const auto write = [&](const std::string& folder, const std::string& text) {
    const std::string file = fmt::format("{}/{}", folder, kMetadataName);
    return target_->batch()->Write(target_->PathOf(file), std::as_bytes(std::span(text)));
  };
  for (const FieldInfo& field : info_.fields) {
    const std::string file = fmt::format("{}/{}", field.name, kMetadataName);
    if (CheckFieldGroup(files_, path_, field.name).ok()) {
      FOVEA_RETURN_IF_ERROR(target_->Keep(file));
      continue;
    }
    FOVEA_RETURN_IF_ERROR(write(field.name, FieldGroupJson()));
    report_.lost.push_back(file + ": what attributes others had put there, if any");
  }
  for (const ArraySpec& array : AllArrays(info_)) {
    const StatusOr<int64_t> steps = ReadArraySteps(files_, path_, array);
    if (steps.ok() && *steps == info_.committed_steps) {
      FOVEA_RETURN_IF_ERROR(target_->Keep(fmt::format("{}/{}", array.path, kMetadataName)));
      continue;
    }
    if (!steps.ok() || *steps < info_.committed_steps) {
      report_.rebuilt.push_back(
          fmt::format("{}/{}: from that of the store", array.path, kMetadataName));
    }
    FOVEA_RETURN_IF_ERROR(write(array.path, ArrayJson(array, info_.committed_steps)));
  }
  const Status copied = ReadGroup(files_, path_, kGroupCopyName).status();
  if (!copied.ok()) {
    if (absl::IsDataLoss(copied)) {
      report_.rebuilt.push_back(fmt::format("{}: from {}", kGroupCopyName, kMetadataName));
    }
    FOVEA_ASSIGN_OR_RETURN(const std::string copy, GroupCopyJson(info_));
    return target_->batch()->Write(target_->PathOf(std::string(kGroupCopyName)),
                                   std::as_bytes(std::span(copy)));
  }
  return target_->Keep(std::string(kGroupCopyName));
}

Status Repairer::WriteRest() {
  FOVEA_RETURN_IF_ERROR(series_.Write(info_));
  if (!target_->in_place() || group_changes_) {
    FOVEA_ASSIGN_OR_RETURN(const std::string group, GroupJson(info_));
    FOVEA_RETURN_IF_ERROR(target_->batch()->Write(target_->PathOf(std::string(kMetadataName)),
                                                  std::as_bytes(std::span(group))));
  }
  return target_->Publish();
}

}  // namespace

StatusOr<RepairReport> Repair(const std::string& path, const RepairOptions& options,
                              const std::function<bool(const RepairReport&)>& before,
                              const std::function<bool(int64_t, int64_t)>& progress,
                              FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  if (const Status there = ListDirectory(files, store).status(); !there.ok()) {
    return absl::IsNotFound(there) ? NotFound("there is no store at {}", store) : there;
  }
  FOVEA_ASSIGN_OR_RETURN(const auto target, RepairTarget::Open(files, store, options.output));
  Repairer repairer(files, store, target.get());
  FOVEA_RETURN_IF_ERROR(repairer.FindInfo());
  FOVEA_RETURN_IF_ERROR(repairer.Coefficients(options.threads, progress));
  FOVEA_RETURN_IF_ERROR(repairer.Series());
  FOVEA_RETURN_IF_ERROR(repairer.Metadata());
  if (before && !before(repairer.report())) {
    return Cancelled("{} was left as it was", store);
  }
  if (repairer.Changes()) {
    FOVEA_RETURN_IF_ERROR(target->Publish());
    FOVEA_RETURN_IF_ERROR(repairer.WriteRest());
  }
  FOVEA_RETURN_IF_ERROR(target->Finish());
  return repairer.report();
}

}  // namespace fovea::store
