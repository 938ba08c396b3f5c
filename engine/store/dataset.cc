#include "engine/store/dataset.h"

#include <algorithm>
#include <mutex>
#include <utility>

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

class StoredDataset final : public Dataset {
 public:
  StoredDataset(FileSystem& files, std::string path, DatasetInfo info)
      : files_(files), path_(std::move(path)), info_(std::move(info)) {}

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
  [[nodiscard]] Status CheckStep(int64_t step) const;
  [[nodiscard]] Status CheckField(const std::string& field) const;

  FileSystem& files_;
  const std::string path_;
  mutable std::mutex mutex_;
  DatasetInfo info_;  // guarded by mutex_
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

Status StoredDataset::CheckStep(int64_t step) const {
  const std::lock_guard lock(mutex_);
  if (step >= 0 && step < info_.committed_steps) {
    return absl::OkStatus();
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
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  FOVEA_ASSIGN_OR_RETURN(
      SeriesChunk<int64_t> chunk,
      ReadSeries<int64_t>(files_, path_, std::string(kTimePath), step, kSeriesSteps, 0));
  return chunk.Row(step)[0];
}

StatusOr<std::optional<int64_t>> StoredDataset::FrameNumber(int64_t step) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  FOVEA_ASSIGN_OR_RETURN(
      SeriesChunk<int64_t> chunk,
      ReadSeries<int64_t>(files_, path_, std::string(kFrameNumberPath), step, kSeriesSteps, 0));
  const int64_t number = chunk.Row(step)[0];
  return number == kNoFrameNumber ? std::nullopt : std::optional(number);
}

StatusOr<FieldStats> StoredDataset::Stats(int64_t step, const std::string& field) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  FOVEA_RETURN_IF_ERROR(CheckField(field));
  FOVEA_ASSIGN_OR_RETURN(
      SeriesChunk<double> range,
      ReadSeries<double>(files_, path_, StatsPath(field), step, kSeriesSteps, 2));
  FOVEA_ASSIGN_OR_RETURN(
      SeriesChunk<uint64_t> histogram,
      ReadSeries<uint64_t>(files_, path_, HistogramPath(field), step, kHistogramSteps, 256));
  FieldStats stats;
  stats.minimum = range.Row(step)[0];
  stats.maximum = range.Row(step)[1];
  const std::span<uint64_t> bins = histogram.Row(step);
  std::copy(bins.begin(), bins.end(), stats.histogram.begin());
  return stats;
}

StatusOr<std::unique_ptr<StepSource>> StoredDataset::OpenStep(int64_t step,
                                                              const std::string& field,
                                                              OnDamage on_damage) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  FOVEA_RETURN_IF_ERROR(CheckField(field));
  return MakeStepSource(files_, path_, info(), step, field, on_damage);
}

}  // namespace

StatusOr<std::shared_ptr<Dataset>> Dataset::Open(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo info, ReadGroup(files, store));
  FOVEA_RETURN_IF_ERROR(CheckArrays(files, store, info));
  return std::make_shared<StoredDataset>(files, store, std::move(info));
}

}  // namespace fovea::store
