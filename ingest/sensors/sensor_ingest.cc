#include "ingest/sensors/sensor_ingest.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <set>
#include <system_error>
#include <utility>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset_writer.h"
#include "ingest/grid_choice.h"
#include "ingest/sensors/reading_stream.h"
#include "ingest/sensors/voxel_box.h"

namespace fovea::ingest {
namespace {

using sensors::ClosedStep;
using Progress = std::function<bool(const SensorProgress&)>;

constexpr int64_t kDetailBands = 7;

/// A field that is 0 everywhere: the coverage of a step that repeats the one before.
sensors::FilledField ZeroField(const Hierarchy& hierarchy, int64_t brick_edge) {
  sensors::FilledField field;
  field.coefficients.hierarchy = hierarchy;
  field.coefficients.coarse = Grid(Box3::OfSize(hierarchy.DimsAt(0)));
  for (int level = 0; level < hierarchy.finest(); ++level) {
    field.coefficients.detail.emplace_back(hierarchy.DimsAt(level), brick_edge,
                                           static_cast<int>(kDetailBands), 0.0F);
  }
  field.stats.histogram[0] = static_cast<uint64_t>(hierarchy.dims().Product());
  return field;
}

class SensorRun {
 public:
  SensorRun(const SensorOptions& options, const Progress& progress)
      : options_(options), progress_(progress) {}

  Status Execute() {
    FOVEA_RETURN_IF_ERROR(CheckOptions());
    FOVEA_ASSIGN_OR_RETURN(inputs_, FindInputs(options_));
    if (options_.append) {
      FOVEA_RETURN_IF_ERROR(OpenExisting());
    } else {
      FOVEA_RETURN_IF_ERROR(ChooseGrid());
    }
    if (report_.interrupted) {
      return absl::OkStatus();
    }
    FOVEA_RETURN_IF_ERROR(StartBinner());
    return Read();
  }
  /// Whatever Execute returned: what was done.
  [[nodiscard]] SensorReport TakeReport() {
    if (binner_) {
      report_.counts = binner_->counts();
    }
    report_.bad_lines = state_.bad.count;
    report_.first_bad_line = state_.bad.first;
    report_.input_bytes = state_.bytes;
    report_.bin_ms -= report_.fill_ms + report_.write_ms;  // steps close inside
    return std::move(report_);
  }

  /// Removes the store that this run made.
  void Discard() {
    writer_.reset();
    if (made_store_) {
      std::error_code ignored;
      std::filesystem::remove_all(options_.output, ignored);
    }
  }

 private:
  [[nodiscard]] int channels() const {
    return static_cast<int>(std::max<size_t>(1, options_.columns.values.size()));
  }
  [[nodiscard]] bool GoOn(const std::string& input) const {
    return progress_ == nullptr ||
           progress_({report_.steps, binner_ ? binner_->counts().read : 0, input});
  }

  Status CheckOptions() const;
  Status ChooseGrid();
  Status OpenExisting();
  Status StartBinner();
  Status Read();
  Status NameFields();
  Status CreateStore();
  Status CommitStep(const ClosedStep& step);
  Status WriteFields(const ClosedStep& step);
  Status WriteOne(const std::string& name, const sensors::FilledField& field);
  Status CheckBricks(const ClosedStep& step) const;
  void NoteDensity(const ClosedStep& step);

  const SensorOptions& options_;
  const Progress& progress_;
  std::vector<std::string> inputs_;
  StreamState state_;
  std::optional<sensors::ReadingBinner> binner_;
  std::unique_ptr<store::DatasetWriter> writer_;
  bool made_store_ = false;
  std::optional<int64_t> last_time_ns_, last_frame_;
  SensorReport report_;
};

Status SensorRun::CheckOptions() const {
  if (options_.output.empty()) {
    return InvalidArgument("no dataset to write was named");
  }
  if (!options_.fields.empty() && std::ssize(options_.fields) != channels()) {
    return InvalidArgument("--field names {} fields, --columns {} values", options_.fields.size(),
                           channels());
  }
  if (!(options_.fill.reach_voxels >= 1) ||
      !(std::abs(options_.fill.background) <= sensors::kLargestValue)) {
    return InvalidArgument("--reach must be at least 1, and --background a number");
  }
  std::error_code error;
  const bool is_new = !std::filesystem::exists(options_.output, error) ||
                      std::filesystem::is_empty(options_.output, error);
  if (!options_.append && !is_new) {
    return AlreadyExists("'{}' is there already: remove it, name another, or add to it (--append)",
                         options_.output);
  }
  return absl::OkStatus();
}

/// Reads everything once for its extent, unless all is said.
Status SensorRun::ChooseGrid() {
  ReadingExtent extent;
  if (!IsComplete(options_.box)) {
    if (inputs_.front() == "-") {
      return InvalidArgument(
          "standard input can be read only once: say where the voxels are with --bounds "
          "X0,Y0,Z0,X1,Y1,Z1 and --voxel SIZE");
    }
    report_.box_was_chosen = true;
    constexpr double kFar = std::numeric_limits<double>::infinity();
    extent.lower = {kFar, kFar, kFar};
    extent.upper = {-kFar, -kFar, -kFar};
    std::set<int64_t> steps;
    const auto on_block = [&](size_t index, ReadingBlock* block) {
      const float* value = block->values.data();
      for (const sensors::Reading& reading : block->readings) {
        const bool good = std::isfinite(reading.x + reading.y + reading.z) &&
                          *value >= options_.least_value && *value <= options_.greatest_value;
        value += channels();
        if (!good) {
          continue;
        }
        const Vec3 place{reading.x, reading.y, reading.z};
        for (int axis = 0; axis < 3; ++axis) {
          extent.lower[axis] = std::min(extent.lower[axis], place[axis]);
          extent.upper[axis] = std::max(extent.upper[axis], place[axis]);
        }
        ++extent.readings;
        const double window = options_.steps_by == StepsBy::kWindow
                                  ? std::floor(reading.time_s / *options_.steps.window_s)
                                  : 0;
        steps.insert(options_.steps_by == StepsBy::kFile  ? static_cast<int64_t>(index)
                     : options_.steps_by == StepsBy::kKey ? reading.step
                     : std::abs(window) < 9e18            ? static_cast<int64_t>(window)
                                                          : 0);
      }
      return absl::OkStatus();
    };
    StreamState first_pass;
    const Stopwatch watch;
    FOVEA_RETURN_IF_ERROR(ReadAll(
        options_, inputs_, [&](const std::string& input) { return GoOn(input); }, on_block,
        &first_pass));
    report_.read_ms += watch.ElapsedMs();
    report_.interrupted = first_pass.interrupted;
    extent.steps = std::ssize(steps);
    if (report_.interrupted) {
      return absl::OkStatus();
    }
  }
  FOVEA_ASSIGN_OR_RETURN(report_.grid, ChooseVoxels(options_.box, extent));
  return absl::OkStatus();
}

Status SensorRun::OpenExisting() {
  FOVEA_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Append(options_.output));
  const store::DatasetInfo& info = writer_->info();
  const StatusOr<sensors::VoxelGrid> grid = VoxelsOfStore(info.hierarchy, info.index_to_world);
  if (!grid.ok()) {
    return Annotate(grid.status(), fmt::format("'{}'", options_.output));
  }
  report_.grid = *grid;
  std::vector<std::string> fields;
  bool has_coverage = false;
  for (const store::FieldInfo& field : info.fields) {
    has_coverage = has_coverage || field.name == kCoverageField;
    if (field.name != kCoverageField) {
      fields.push_back(field.name);
    }
    if (field.type != "float32" || info.wavelet != "haar") {
      return FailedPrecondition("'{}' holds {} {} coefficients: readings become haar float32",
                                options_.output, info.wavelet, field.type);
    }
  }
  if (!has_coverage || std::ssize(fields) != channels()) {
    return FailedPrecondition(
        "'{}' has {} fields and {} coverage: to add readings of {} values it must have been made "
        "of such (fovea sensors)",
        options_.output, fields.size(), has_coverage ? "a" : "no", channels());
  }
  report_.fields = fields;
  const int64_t steps = info.committed_steps;
  if (steps > 0) {
    FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(options_.output));
    FOVEA_ASSIGN_OR_RETURN(last_time_ns_, dataset->TimeNs(steps - 1));
    FOVEA_ASSIGN_OR_RETURN(last_frame_, dataset->FrameNumber(steps - 1));
  }
  return absl::OkStatus();
}

Status SensorRun::StartBinner() {
  sensors::BinnerOptions binner;
  binner.grid = report_.grid;
  binner.channels = channels();
  binner.least_value = options_.least_value;
  binner.greatest_value = options_.greatest_value;
  binner.duplicates = options_.duplicates;
  binner.steps = options_.steps;
  if (options_.steps_by == StepsBy::kWindow && last_time_ns_) {
    // The window behind the last one that is stored; half of one more against rounding.
    binner.steps.first_window =
        static_cast<int64_t>(
            std::floor((static_cast<double>(*last_time_ns_) / 1e9 - binner.steps.start_s) /
                           *binner.steps.window_s +
                       0.5)) +
        1;
  }
  const double memory =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  binner.most_pending = std::min<int64_t>(
      int64_t{1} << 31, static_cast<int64_t>(memory / 4) / (48 + 8 * binner.channels));
  FOVEA_ASSIGN_OR_RETURN(binner_, sensors::ReadingBinner::Make(binner, [this](const ClosedStep& s) {
                           return CommitStep(s);
                         }));
  return absl::OkStatus();
}

Status SensorRun::Read() {
  Stopwatch watch;
  const int64_t first_file_step = last_frame_.value_or(-1) + 1;
  const auto on_block = [&](size_t index, ReadingBlock* block) {
    report_.read_ms += watch.RestartMs();
    if (options_.steps_by == StepsBy::kFile) {
      for (sensors::Reading& reading : block->readings) {
        reading.step = first_file_step + static_cast<int64_t>(index);
      }
    }
    const Status status = binner_->Add(block->readings, block->values);
    report_.bin_ms += watch.RestartMs();
    return status;
  };
  FOVEA_RETURN_IF_ERROR(ReadAll(
      options_, inputs_, [&](const std::string& input) { return GoOn(input); }, on_block, &state_));
  report_.read_ms += watch.RestartMs();
  report_.interrupted = state_.interrupted;
  if (report_.interrupted) {
    return absl::OkStatus();
  }
  const Status status = binner_->Finish();
  report_.bin_ms += watch.ElapsedMs();
  FOVEA_RETURN_IF_ERROR(status);
  if (report_.steps == 0 && !options_.append) {
    const sensors::ReadingCounts& c = binner_->counts();
    return FailedPrecondition(
        "no step came of {} readings: {} outside of the box, {} not finite, {} out of range; look "
        "at --columns and --bounds",
        c.read, c.outside, c.not_finite, c.out_of_range);
  }
  return absl::OkStatus();
}

Status SensorRun::NameFields() {
  const std::vector<std::string>& names =
      options_.fields.empty() ? state_.value_names : options_.fields;
  for (const std::string& name : names) {
    const std::string field = FieldNameOf(name);
    if (field != name) {
      report_.warnings.push_back(fmt::format("'{}' becomes field '{}'", name, field));
    }
    if (field == kCoverageField ||
        std::find(report_.fields.begin(), report_.fields.end(), field) != report_.fields.end()) {
      return InvalidArgument("two fields would be called '{}': name them otherwise with --field",
                             field);
    }
    report_.fields.push_back(field);
  }
  return absl::OkStatus();
}

/// Late, when there is a step to be written: what fails at once leaves nothing.
Status SensorRun::CreateStore() {
  FOVEA_RETURN_IF_ERROR(NameFields());
  store::DatasetInfo info;
  info.hierarchy = report_.grid.hierarchy;
  info.index_to_world = report_.grid.IndexToWorld();
  info.world_unit = options_.world_unit;
  info.clock = options_.clock;
  info.chunk_edge = options_.chunk_edge;
  info.default_field = report_.fields.front();
  for (const std::string& name : report_.fields) {
    store::FieldInfo& field = info.fields.emplace_back();
    field.name = name;
    field.value_unit = options_.value_unit;
  }
  info.fields.emplace_back().name = kCoverageField;
  FOVEA_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Create(options_.output, info));
  made_store_ = true;
  return absl::OkStatus();
}

Status SensorRun::CheckBricks(const ClosedStep& step) const {
  const int64_t edge = writer_->info().chunk_edge;
  const double need =
      static_cast<double>(sensors::CountBricks(report_.grid.hierarchy, edge, step.voxels.keys) *
                          kDetailBands * edge * edge * edge * static_cast<int64_t>(sizeof(float)));
  const double have =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (need > have / 4) {
    return ResourceExhausted(
        "{} voxels with readings lie so far apart that a step needs {:.1f} GB, more than a quarter "
        "of this machine's memory: make voxels larger (--voxel), or chunks smaller (--chunk 8)",
        step.voxels.keys.size(), need / 1e9);
  }
  return absl::OkStatus();
}

Status SensorRun::WriteOne(const std::string& name, const sensors::FilledField& field) {
  const Stopwatch watch;
  const Status status = writer_->WriteField(name, field.coefficients, field.stats);
  report_.write_ms += watch.ElapsedMs();
  return status;
}

Status SensorRun::WriteFields(const ClosedStep& step) {
  const Hierarchy& hierarchy = report_.grid.hierarchy;
  const int64_t edge = writer_->info().chunk_edge;
  Stopwatch watch;
  for (size_t channel = 0; channel < report_.fields.size(); ++channel) {
    watch.RestartMs();
    const sensors::FilledField field = sensors::FillField(
        hierarchy, edge, step.voxels.keys, step.voxels.values[channel], options_.fill);
    report_.fill_ms += watch.ElapsedMs();
    FOVEA_RETURN_IF_ERROR(WriteOne(report_.fields[channel], field));
  }
  watch.RestartMs();
  const sensors::FilledField coverage =
      step.held ? ZeroField(hierarchy, edge)
                : sensors::FillCoverage(hierarchy, edge, step.voxels.keys, options_.fill);
  report_.fill_ms += watch.ElapsedMs();
  return WriteOne(kCoverageField, coverage);
}

void SensorRun::NoteDensity(const ClosedStep& step) {
  if (!step.held && std::ssize(step.voxels.keys) > report_.measured_voxels) {
    report_.measured_voxels = std::ssize(step.voxels.keys);
    report_.density = sensors::MeasureDensity(report_.grid.hierarchy, step.voxels);
  }
}

Status SensorRun::CommitStep(const ClosedStep& step) {
  if (writer_ == nullptr) {
    const Stopwatch watch;
    FOVEA_RETURN_IF_ERROR(CreateStore());
    report_.write_ms += watch.ElapsedMs();
  }
  FOVEA_RETURN_IF_ERROR(CheckBricks(step));
  FOVEA_RETURN_IF_ERROR(WriteFields(step));
  const int64_t time_ns = std::max(step.time_ns, last_time_ns_.value_or(step.time_ns));
  const Stopwatch watch;
  FOVEA_RETURN_IF_ERROR(writer_->Commit(time_ns, step.frame_number));
  report_.write_ms += watch.ElapsedMs();
  last_time_ns_ = time_ns;
  ++report_.steps;
  NoteDensity(step);
  return absl::OkStatus();
}

}  // namespace

StatusOr<SensorReport> IngestSensors(const SensorOptions& options,
                                     const std::function<bool(const SensorProgress&)>& progress) {
  SensorRun run(options, progress);
  const Status status = run.Execute();
  SensorReport report = run.TakeReport();
  if (status.ok()) {
    return report;
  }
  if (report.steps == 0) {
    run.Discard();
    return status;
  }
  return MakeStatus(
      status.code(),
      fmt::format("{} (what was done before stays: {} {} in '{}')", MessageOf(status), report.steps,
                  report.steps == 1 ? "step" : "steps", options.output));
}

}  // namespace fovea::ingest
