#include "engine/store/dataset_writer.h"

#include <algorithm>
#include <limits>
#include <map>
#include <mutex>
#include <span>
#include <string_view>
#include <utility>

#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"
#include "engine/store/field_writer.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/metadata.h"
#include "engine/store/store_folder.h"

// A commit, in the order in which it reaches the disk:
//   1. every file of the step is written under a temporary name and flushed: its shards, the
//      chunks of time, stats ... that hold its row, every array's zarr.json with one more step,
//      the group's zarr.json. A full disk shows here, before anything has changed.
//   2. the data files are renamed, then the arrays' zarr.json, and their directories flushed;
//   3. the group's zarr.json is renamed: the step is committed. Its directory is flushed.
// Whoever dies before 3 leaves temporary files and files of a step that is not committed; the
// next writer removes both before it does anything else.

namespace fovea::store {
namespace {

/// The rows in memory of the small arrays whose chunks a commit rewrites.
struct FieldSeries {
  SeriesChunk<double> stats{kSeriesSteps, 2, 0.0};
  SeriesChunk<uint64_t> histogram{kHistogramSteps, 256, 0};
};
struct Series {
  SeriesChunk<int64_t> time{kSeriesSteps, 1, 0};
  SeriesChunk<int64_t> frame_number{kSeriesSteps, 1, kNoFrameNumber};
  std::map<std::string, FieldSeries> fields;
  int64_t last_time_ns = std::numeric_limits<int64_t>::min();
};

/// Makes the rows from `step` on what they are in a new chunk.
template <typename T>
void ClearFrom(int64_t step, T fill, SeriesChunk<T>* chunk) {
  const int64_t row = step % chunk->steps;
  std::fill(chunk->values.begin() + row * chunk->width, chunk->values.end(), fill);
}

/// The chunk that the row of step `next` goes into, with the rows of the steps before it.
template <typename T>
Status LoadSeries(FileSystem& files, const std::string& store_path, const std::string& array,
                  int64_t next, bool has_rows, T fill, SeriesChunk<T>* chunk) {
  if (next % chunk->steps != 0) {
    FOVEA_ASSIGN_OR_RETURN(*chunk, ReadSeries<T>(files, store_path, array, next - 1, chunk->steps,
                                                 has_rows ? chunk->width : 0));
  }
  ClearFrom(next, fill, chunk);
  return absl::OkStatus();
}

StatusOr<Series> LoadAllSeries(FileSystem& files, const std::string& path,
                               const DatasetInfo& info) {
  Series series;
  const int64_t next = info.committed_steps;
  const std::string time(kTimePath);
  FOVEA_RETURN_IF_ERROR(LoadSeries<int64_t>(files, path, time, next, false, 0, &series.time));
  FOVEA_RETURN_IF_ERROR(LoadSeries<int64_t>(files, path, std::string(kFrameNumberPath), next, false,
                                            kNoFrameNumber, &series.frame_number));
  for (const FieldInfo& field : info.fields) {
    FieldSeries& rows = series.fields[field.name];
    FOVEA_RETURN_IF_ERROR(
        LoadSeries<double>(files, path, StatsPath(field.name), next, true, 0.0, &rows.stats));
    FOVEA_RETURN_IF_ERROR(LoadSeries<uint64_t>(files, path, HistogramPath(field.name), next, true,
                                               0, &rows.histogram));
  }
  if (next > 0) {
    FOVEA_ASSIGN_OR_RETURN(SeriesChunk<int64_t> last,
                           ReadSeries<int64_t>(files, path, time, next - 1, kSeriesSteps, 0));
    series.last_time_ns = last.Row(next - 1)[0];
  }
  return series;
}

template <typename T>
Status WriteSeries(const std::string& store_path, const std::string& array, int64_t step,
                   bool has_rows, SeriesChunk<T>* chunk, FileBatch* batch) {
  Encoder encoder;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded, encoder.Encode(chunk->Bytes()));
  return batch->Write(SeriesPath(store_path, array, step, chunk->steps, has_rows), encoded);
}

class Writer final : public DatasetWriter {
 public:
  Writer(FileSystem& files, std::string path, DatasetInfo info, WriterLock lock, Series series)
      : directories_(files.WithOpenDirectories()),
        files_(directories_ != nullptr ? *directories_ : files),
        path_(std::move(path)),
        info_(std::move(info)),
        lock_(std::move(lock)),
        arrays_(AllArrays(info_)),
        series_(std::move(series)),
        next_(info_),
        published_series_(series_),
        ended_(files_),
        batch_(files_) {}

  [[nodiscard]] const DatasetInfo& info() const override { return info_; }
  [[nodiscard]] StatusOr<std::unique_ptr<FieldWriter>> BeginField(
      const std::string& field) override;
  [[nodiscard]] Status WriteField(const std::string& field, const CoefficientSet& coefficients,
                                  const FieldStats& stats) override;
  void NoteMaxError(const std::string& field, double max_error) override {
    max_errors_[field] = max_error;
  }
  [[nodiscard]] Status EndStep(int64_t time_ns, std::optional<int64_t> frame_number) override;
  [[nodiscard]] Status Publish() override;

 private:
  [[nodiscard]] Status CheckCommit(int64_t time_ns, std::optional<int64_t> frame_number) const;
  void SetRows(int64_t time_ns, std::optional<int64_t> frame_number);
  /// Writes the chunks of the small arrays that hold the row of `step`: those that it fills, or
  /// those that it does not.
  [[nodiscard]] Status WriteAllSeries(int64_t step, bool full_ones);
  [[nodiscard]] Status EndStepFiles(int64_t time_ns, std::optional<int64_t> frame_number);
  /// Brings everything that the commit will need to the disk, under temporary names.
  [[nodiscard]] Status PrepareCommit();
  [[nodiscard]] DatasetInfo InfoAfterStep() const;
  [[nodiscard]] Status CheckUsable() const;
  void EndField(const std::string& field, int64_t drops, const FieldStats* stats, FileBatch* batch);
  void DropStep();
  void DropEnded();

  std::unique_ptr<FileSystem> directories_;  // or null
  FileSystem& files_;                        // what steps are written through
  std::string path_;
  DatasetInfo info_;
  WriterLock lock_;
  std::vector<ArraySpec> arrays_;
  EncoderPool encoders_;
  Series series_;
  // The steps that were ended: next_ is what info_ will be.
  DatasetInfo next_;
  Series published_series_;
  FileBatch ended_;
  // The step in hand. What its fields, several at once, change when they end is under mutex_.
  std::mutex mutex_;
  FileBatch batch_;
  std::map<std::string, FieldStats> written_;
  int64_t drops_ = 0;                         // steps that were dropped
  std::map<std::string, double> max_errors_;  // of quantised fields
  bool broken_ = false;  // a commit failed halfway: what is on disk is not what we hold
};

Status Writer::CheckUsable() const {
  if (broken_) {
    return FailedPrecondition(
        "{}: the last commit failed halfway; open the store again to go on writing", path_);
  }
  return absl::OkStatus();
}

void Writer::DropStep() {
  ++drops_;
  batch_.Discard();
  written_.clear();
  max_errors_.clear();
}

void Writer::DropEnded() {
  DropStep();
  ended_.Discard();
  next_ = info_;
  series_ = published_series_;
}

void Writer::EndField(const std::string& field, int64_t drops, const FieldStats* stats,
                      FileBatch* batch) {
  const std::lock_guard lock(mutex_);
  if (stats == nullptr) {
    DropStep();
  } else if (drops == drops_) {  // another field of the step may have failed since
    batch_.Absorb(batch);
    written_[field] = *stats;
  }
}

StatusOr<std::unique_ptr<FieldWriter>> Writer::BeginField(const std::string& field) {
  FOVEA_RETURN_IF_ERROR(CheckUsable());
  const auto is_field = [&](const FieldInfo& known) { return known.name == field; };
  if (std::none_of(info_.fields.begin(), info_.fields.end(), is_field)) {
    return NotFound("{} has no field '{}'", path_, field);
  }
  const std::lock_guard lock(mutex_);
  if (written_.contains(field)) {
    return FailedPrecondition("field '{}' of this step was written already", field);
  }
  return std::make_unique<FieldWriter>(
      files_, path_, next_, field, &encoders_,
      [this, field, drops = drops_](const FieldStats* stats, FileBatch* batch) {
        EndField(field, drops, stats, batch);
      });
}

Status Writer::WriteField(const std::string& field, const CoefficientSet& coefficients,
                          const FieldStats& stats) {
  auto writer = BeginField(field);
  Status status = writer.status();
  if (status.ok()) {
    status = CheckCoefficients(info_, field, coefficients);
  }
  if (status.ok()) {
    status = AddAllDetail(coefficients, writer->get());
  }
  if (!status.ok()) {
    DropStep();
    return Annotate(status, fmt::format("field '{}' of step {}", field, next_.committed_steps));
  }
  return (*writer)->Finish(coefficients.coarse, stats);
}

Status Writer::CheckCommit(int64_t time_ns, std::optional<int64_t> frame_number) const {
  FOVEA_RETURN_IF_ERROR(CheckUsable());
  for (const FieldInfo& field : info_.fields) {
    if (!written_.contains(field.name)) {
      return FailedPrecondition("field '{}' of step {} has not been written", field.name,
                                next_.committed_steps);
    }
  }
  if (time_ns < series_.last_time_ns) {
    return InvalidArgument("step {} at {} ns would be before the last step, at {} ns",
                           next_.committed_steps, time_ns, series_.last_time_ns);
  }
  if (frame_number == kNoFrameNumber) {
    return InvalidArgument("frame number {} stands for no number", kNoFrameNumber);
  }
  if (next_.committed_steps >= kMaxSteps) {
    return ResourceExhausted("{} is full: it has {} steps", path_, kMaxSteps);
  }
  return absl::OkStatus();
}

void Writer::SetRows(int64_t time_ns, std::optional<int64_t> frame_number) {
  const int64_t step = next_.committed_steps;
  ClearFrom<int64_t>(step, 0, &series_.time);
  ClearFrom(step, kNoFrameNumber, &series_.frame_number);
  series_.time.Row(step)[0] = time_ns;
  series_.frame_number.Row(step)[0] = frame_number.value_or(kNoFrameNumber);
  for (const auto& [name, stats] : written_) {
    FieldSeries& rows = series_.fields[name];
    ClearFrom(step, 0.0, &rows.stats);
    ClearFrom<uint64_t>(step, 0, &rows.histogram);
    rows.stats.Row(step)[0] = stats.minimum;
    rows.stats.Row(step)[1] = stats.maximum;
    std::copy(stats.histogram.begin(), stats.histogram.end(), rows.histogram.Row(step).begin());
  }
}

Status Writer::WriteAllSeries(int64_t step, bool full_ones) {
  const auto write = [&](const std::string& array, bool has_rows, auto* chunk) -> Status {
    const bool is_full = (step + 1) % chunk->steps == 0;
    return is_full == full_ones ? WriteSeries(path_, array, step, has_rows, chunk, &batch_)
                                : absl::OkStatus();
  };
  FOVEA_RETURN_IF_ERROR(write(std::string(kTimePath), false, &series_.time));
  FOVEA_RETURN_IF_ERROR(write(std::string(kFrameNumberPath), false, &series_.frame_number));
  for (auto& [name, rows] : series_.fields) {
    FOVEA_RETURN_IF_ERROR(write(StatsPath(name), true, &rows.stats));
    FOVEA_RETURN_IF_ERROR(write(HistogramPath(name), true, &rows.histogram));
  }
  return absl::OkStatus();
}

DatasetInfo Writer::InfoAfterStep() const {
  DatasetInfo info = next_;
  for (FieldInfo& field : info.fields) {
    const FieldStats& stats = written_.at(field.name);
    const bool first = info.committed_steps == 0;
    field.minimum = first ? stats.minimum : std::min(field.minimum, stats.minimum);
    field.maximum = first ? stats.maximum : std::max(field.maximum, stats.maximum);
    if (const auto error = max_errors_.find(field.name); error != max_errors_.end()) {
      field.max_error = std::max(field.max_error, error->second);
    }
  }
  ++info.committed_steps;
  return info;
}

Status Writer::PrepareCommit() {
  FOVEA_RETURN_IF_ERROR(WriteAllSeries(next_.committed_steps - 1, /*full_ones=*/false));
  ended_.Absorb(&batch_);
  ended_.EndUnordered();
  FOVEA_RETURN_IF_ERROR(WriteMetadata(path_, next_, arrays_, &batch_));
  ended_.Absorb(&batch_);
  return ended_.Flush();
}

Status Writer::EndStepFiles(int64_t time_ns, std::optional<int64_t> frame_number) {
  FOVEA_RETURN_IF_ERROR(CheckCommit(time_ns, frame_number));
  SetRows(time_ns, frame_number);
  // The next row begins other chunks.
  return WriteAllSeries(next_.committed_steps, /*full_ones=*/true);
}

Status Writer::EndStep(int64_t time_ns, std::optional<int64_t> frame_number) {
  if (const Status status = EndStepFiles(time_ns, frame_number); !status.ok()) {
    DropStep();
    return Annotate(status, fmt::format("step {} was not committed", next_.committed_steps));
  }
  next_ = InfoAfterStep();
  series_.last_time_ns = time_ns;
  ended_.Absorb(&batch_);
  written_.clear();
  max_errors_.clear();
  const bool is_enough = next_.committed_steps - info_.committed_steps >= kMostStepsAtOnce;
  return is_enough ? Publish() : absl::OkStatus();
}

Status Writer::Publish() {
  FOVEA_RETURN_IF_ERROR(CheckUsable());
  if (next_.committed_steps == info_.committed_steps) {
    return absl::OkStatus();
  }
  DropStep();
  Status status = PrepareCommit();
  if (status.ok()) {
    status = ended_.Publish();
    broken_ = !status.ok();
  }
  if (!status.ok()) {
    const std::string_view how = broken_ ? "may not have been" : "was not";
    const int64_t first = info_.committed_steps, last = next_.committed_steps - 1;
    DropEnded();
    const std::string one = fmt::format("step {}", first);
    const std::string which = first == last ? one : fmt::format("steps {} to {}:", first, last);
    return Annotate(status, fmt::format("{} {} committed", which, how));
  }
  info_ = next_;
  published_series_ = series_;
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::unique_ptr<DatasetWriter>> DatasetWriter::Create(const std::string& path,
                                                               const DatasetInfo& info,
                                                               FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  DatasetInfo empty = info;
  empty.committed_steps = 0;
  for (FieldInfo& field : empty.fields) {
    field.minimum = field.maximum = field.max_error = 0;
  }
  // As a reader will see them.
  std::sort(empty.fields.begin(), empty.fields.end(),
            [](const FieldInfo& a, const FieldInfo& b) { return a.name < b.name; });
  FOVEA_RETURN_IF_ERROR(GroupJson(empty).status());  // before anything is made
  FOVEA_ASSIGN_OR_RETURN(WriterLock lock, ClaimFolder(files, store));
  FOVEA_RETURN_IF_ERROR(MakeEmptyStore(files, store, empty));
  FOVEA_ASSIGN_OR_RETURN(Series series, LoadAllSeries(files, store, empty));
  return std::make_unique<Writer>(files, store, std::move(empty), std::move(lock),
                                  std::move(series));
}

StatusOr<std::unique_ptr<DatasetWriter>> DatasetWriter::Append(const std::string& path,
                                                               FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_RETURN_IF_ERROR(ReadGroup(files, store).status());  // no lock file in what is no store
  FOVEA_ASSIGN_OR_RETURN(WriterLock lock, WriterLock::Take(files, store));
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo info, ReadGroup(files, store));
  FOVEA_RETURN_IF_ERROR(SweepStore(files, store, info));
  FOVEA_ASSIGN_OR_RETURN(Series series, LoadAllSeries(files, store, info));
  return std::make_unique<Writer>(files, store, std::move(info), std::move(lock),
                                  std::move(series));
}

}  // namespace fovea::store
