#include "engine/store/dataset.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/store/chunk_file.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/metadata.h"
#include "engine/store/step_source.h"

namespace fovea::store {

const FieldInfo& DatasetInfo::FieldOf(const std::string& field) const {
  const auto is_field = [&](const FieldInfo& known) { return known.name == field; };
  return *std::find_if(fields.begin(), fields.end(), is_field);
}

bool DatasetInfo::IsLost(const std::string& field, int64_t step) const {
  const std::vector<int64_t>& lost = FieldOf(field).lost_steps;
  return std::binary_search(lost.begin(), lost.end(), step);
}

bool IsComplete(const DatasetInfo& info) {
  return info.source && info.source->steps > 0 &&
         info.committed_steps >= info.source->LastStep() - info.source->FirstStep();
}

namespace {

/// Every array must be what the group says, and have the committed steps.
Status CheckArrays(FileSystem& files, const std::string& path, const DatasetInfo& info) {
  for (const FieldInfo& field : info.fields) {
    FOVEA_RETURN_IF_ERROR(CheckFieldGroup(files, path, field.name));
  }
  for (const ArraySpec& array : AllArrays(info)) {
    FOVEA_ASSIGN_OR_RETURN(const int64_t steps, ReadArraySteps(files, path, array));
    if (steps < info.committed_steps) {
      return DataLoss("{}/{} has {} steps, the store {}", path, array.path, steps,
                      info.committed_steps);
    }
  }
  return absl::OkStatus();
}

/// The chunk that was read last of an array over steps, so that a series of rows costs one read for
/// all of its chunk. Rows of committed steps never change. Thread-safe.
template <typename T>
class LastChunk {
 public:
  /// The row of `step`, of `width` values (0: the array has no second axis), when `committed` steps
  /// are there.
  [[nodiscard]] StatusOr<std::vector<T>> Row(FileSystem& files, const std::string& store_path,
                                             const std::string& array, int64_t step, int64_t steps,
                                             int64_t width, int64_t committed) {
    const std::lock_guard lock(mutex_);
    if (!chunk_ || step < first_ || step >= std::min(first_ + steps, end_)) {
      chunk_.reset();
      FOVEA_ASSIGN_OR_RETURN(chunk_, ReadSeries<T>(files, store_path, array, step, steps, width));
      first_ = step / steps * steps;
      end_ = committed;
    }
    const std::span<T> row = chunk_->Row(step);
    return std::vector<T>(row.begin(), row.end());
  }

 private:
  std::mutex mutex_;
  std::optional<SeriesChunk<T>> chunk_;  // guarded by mutex_, like the rest
  int64_t first_ = 0;                    // step of its first row
  int64_t end_ = 0;                      // steps that were there when it was read
};

struct LastStats {
  LastChunk<double> range;
  LastChunk<uint64_t> histogram;
};

class StoredDataset final : public Dataset {
 public:
  StoredDataset(FileSystem& files, std::string path, DatasetInfo info)
      : files_(files), path_(std::move(path)), info_(std::move(info)) {
    for (const FieldInfo& field : info_.fields) {
      stats_[field.name];
    }
  }

  [[nodiscard]] const std::string& path() const override { return path_; }
  [[nodiscard]] DatasetInfo info() const override {
    const std::lock_guard lock(mutex_);
    return info_;
  }
  [[nodiscard]] Status Refresh() override;
  [[nodiscard]] StatusOr<int64_t> TimeNs(int64_t step) override;
  [[nodiscard]] StatusOr<std::optional<int64_t>> FrameNumber(int64_t step) override;
  [[nodiscard]] StatusOr<FieldStats> Stats(int64_t step, const std::string& field) override;
  [[nodiscard]] StatusOr<std::unique_ptr<StepSource>> OpenStep(int64_t step,
                                                               const std::string& field,
                                                               OnDamage on_damage) override;

 private:
  /// How many steps there are.
  [[nodiscard]] StatusOr<int64_t> CheckStep(int64_t step) const;
  [[nodiscard]] Status CheckField(const std::string& field) const;

  FileSystem& files_;
  const std::string path_;
  mutable std::mutex mutex_;
  DatasetInfo info_;  // guarded by mutex_
  LastChunk<int64_t> times_, numbers_;
  std::map<std::string, LastStats> stats_;  // by field; all are there from the start
};

Status StoredDataset::Refresh() {
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo fresh, ReadGroup(files_, path_));
  const auto same_name = [](const FieldInfo& a, const FieldInfo& b) { return a.name == b.name; };
  const std::lock_guard lock(mutex_);
  if (fresh.hierarchy != info_.hierarchy || fresh.chunk_edge != info_.chunk_edge ||
      fresh.wavelet != info_.wavelet ||
      !std::equal(fresh.fields.begin(), fresh.fields.end(), info_.fields.begin(),
                  info_.fields.end(), same_name)) {
    return FailedPrecondition("{} was replaced by another store; open it again", path_);
  }
  info_ = std::move(fresh);
  return absl::OkStatus();
}

StatusOr<int64_t> StoredDataset::CheckStep(int64_t step) const {
  const std::lock_guard lock(mutex_);
  if (step >= 0 && step < info_.committed_steps) {
    return info_.committed_steps;
  }
  return info_.committed_steps == 0 ? OutOfRange("step {}: {} has no steps yet", step, path_)
                                    : OutOfRange("step {} is outside 0 to {}, the steps of {}",
                                                 step, info_.committed_steps - 1, path_);
}

Status StoredDataset::CheckField(const std::string& field) const {
  const std::lock_guard lock(mutex_);
  std::string names;
  for (const FieldInfo& known : info_.fields) {
    if (known.name == field) {
      return absl::OkStatus();
    }
    names += (names.empty() ? "" : ", ") + known.name;
  }
  return NotFound("{} has no field '{}'; it has {}", path_, field, names);
}

StatusOr<int64_t> StoredDataset::TimeNs(int64_t step) {
  FOVEA_ASSIGN_OR_RETURN(const int64_t committed, CheckStep(step));
  FOVEA_ASSIGN_OR_RETURN(const auto row, times_.Row(files_, path_, std::string(kTimePath), step,
                                                    kSeriesSteps, 0, committed));
  return row[0];
}

StatusOr<std::optional<int64_t>> StoredDataset::FrameNumber(int64_t step) {
  FOVEA_ASSIGN_OR_RETURN(const int64_t committed, CheckStep(step));
  FOVEA_ASSIGN_OR_RETURN(const auto row, numbers_.Row(files_, path_, std::string(kFrameNumberPath),
                                                      step, kSeriesSteps, 0, committed));
  return row[0] == kNoFrameNumber ? std::nullopt : std::optional(row[0]);
}

StatusOr<FieldStats> StoredDataset::Stats(int64_t step, const std::string& field) {
  FOVEA_ASSIGN_OR_RETURN(const int64_t committed, CheckStep(step));
  FOVEA_RETURN_IF_ERROR(CheckField(field));
  LastStats& last = stats_.at(field);
  FOVEA_ASSIGN_OR_RETURN(const auto range, last.range.Row(files_, path_, StatsPath(field), step,
                                                          kSeriesSteps, 2, committed));
  FOVEA_ASSIGN_OR_RETURN(const auto histogram,
                         last.histogram.Row(files_, path_, HistogramPath(field), step,
                                            kHistogramSteps, 256, committed));
  FieldStats stats;
  stats.minimum = range[0];
  stats.maximum = range[1];
  std::copy(histogram.begin(), histogram.end(), stats.histogram.begin());
  return stats;
}

StatusOr<std::unique_ptr<StepSource>> StoredDataset::OpenStep(int64_t step,
                                                              const std::string& field,
                                                              OnDamage on_damage) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step).status());
  FOVEA_RETURN_IF_ERROR(CheckField(field));
  return MakeStepSource(files_, path_, info(), step, field, on_damage);
}

}  // namespace

StatusOr<std::shared_ptr<Dataset>> Dataset::Open(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo info, ReadGroup(files, store));
  Status checked = CheckArrays(files, store, info);
  if (!checked.ok()) {  // it may have been removed, or replaced, since its group was read
    FOVEA_ASSIGN_OR_RETURN(info, ReadGroup(files, store));
    checked = CheckArrays(files, store, info);
  }
  FOVEA_RETURN_IF_ERROR(checked);
  return std::make_shared<StoredDataset>(files, store, std::move(info));
}

}  // namespace fovea::store
