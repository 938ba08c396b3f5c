#include "ingest/sensors/sensor_ingest.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <set>
#include <system_error>
#include <utility>

#include "engine/base/stopwatch.h"
#include "engine/store/removal.h"
#include "ingest/grid_choice.h"
#include "ingest/sensors/reading_stream.h"
#include "ingest/sensors/sensor_store.h"
#include "ingest/sensors/voxel_box.h"

namespace fovea::ingest {
namespace {

using sensors::ClosedStep;
using Progress = std::function<bool(const SensorProgress&)>;

double Seconds(int64_t time_ns) {
  return static_cast<double>(time_ns) / 1e9;
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
    if (store_ != nullptr) {
      WarnOfMovedTimes();
      report_.fill_ms = store_->fill_ms();
      report_.write_ms = store_->write_ms();
    }
    report_.bin_ms -= report_.fill_ms + report_.write_ms;  // steps close inside
    return std::move(report_);
  }

  /// Removes the store that this run made.
  void Discard() {
    if (made_store_) {
      [[maybe_unused]] const Status removed = store::RemoveHeldStore(options_.output);
    }
    store_.reset();
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
  void OrderFieldsAsRead();
  Status CommitStep(const ClosedStep& step);
  [[nodiscard]] std::string TimeOrigin() const;
  Status CheckGoesOn(const ClosedStep& step) const;
  void WarnOfMovedTimes();
  void NoteDensity(const ClosedStep& step);

  const SensorOptions& options_;
  const Progress& progress_;
  std::vector<std::string> inputs_;
  StreamState state_;
  std::optional<sensors::ReadingBinner> binner_;
  std::unique_ptr<SensorStore> store_;
  bool made_store_ = false;
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
  FOVEA_ASSIGN_OR_RETURN(store_, SensorStore::Append(options_.output));
  report_.grid = store_->grid();
  report_.fields = store_->fields();
  if (std::ssize(report_.fields) != channels()) {
    return FailedPrecondition(
        "'{}' was made of readings of {} values, and these have {}: --columns says which",
        options_.output, report_.fields.size(), channels());
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
  if (options_.steps_by == StepsBy::kWindow && store_ != nullptr) {
    binner.steps.first_window = store_->NextWindow(binner.steps.start_s, *binner.steps.window_s);
  }
  binner.most_pending = MostPendingReadings(binner.channels);
  FOVEA_ASSIGN_OR_RETURN(binner_, sensors::ReadingBinner::Make(binner, [this](const ClosedStep& s) {
                           return CommitStep(s);
                         }));
  return absl::OkStatus();
}

Status SensorRun::Read() {
  Stopwatch watch;
  const int64_t first_file_step =
      (store_ != nullptr ? store_->last_frame_number().value_or(-1) : -1) + 1;
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
  FOVEA_ASSIGN_OR_RETURN(store_,
                         SensorStore::Create(options_.output, {.grid = report_.grid,
                                                               .fields = report_.fields,
                                                               .world_unit = options_.world_unit,
                                                               .value_unit = options_.value_unit,
                                                               .clock = options_.clock,
                                                               .chunk_edge = options_.chunk_edge}));
  made_store_ = true;
  return absl::OkStatus();
}

void SensorRun::NoteDensity(const ClosedStep& step) {
  if (!step.held && std::ssize(step.voxels.keys) > report_.measured_voxels) {
    report_.measured_voxels = std::ssize(step.voxels.keys);
    report_.density = sensors::MeasureDensity(report_.grid.hierarchy, step.voxels);
  }
}

/// A store lists its fields by name; values come as the input has them.
void SensorRun::OrderFieldsAsRead() {
  std::vector<std::string> names;
  for (const std::string& name : state_.value_names) {
    names.push_back(FieldNameOf(name));
  }
  // Fields that were named otherwise when the store was made keep their order.
  if (store_->OrderFields(names).ok()) {
    report_.fields = names;
  }
}

std::string SensorRun::TimeOrigin() const {
  std::string origin = "times count from 0 of the readings' time column, dates from 1970 UTC";
  if (!store_->clock().empty()) {
    origin += fmt::format("; '{}' says that time 0 is: {}", options_.output, store_->clock());
  }
  return origin;
}

/// What is added may not begin before the dataset ends: its times would all become that of the end.
Status SensorRun::CheckGoesOn(const ClosedStep& step) const {
  if (store_->last_time_ns().value_or(step.time_ns) <= step.time_ns) {
    return absl::OkStatus();
  }
  return FailedPrecondition(
      "--append: the readings begin at {} s, but the last step of '{}' is at {} s: steps go "
      "forward "
      "in time, and nothing was added ({}); give readings that go on from there, or make another "
      "dataset",
      Seconds(step.time_ns), options_.output, Seconds(*store_->last_time_ns()), TimeOrigin());
}

void SensorRun::WarnOfMovedTimes() {
  const MovedTimes& moved = store_->moved();
  if (moved.steps > 0) {
    report_.warnings.push_back(fmt::format(
        "{} begin{} earlier than the step before, and got its time, first {} s for {} s; {}",
        moved.steps == 1 ? "1 step" : fmt::format("{} steps", moved.steps),
        moved.steps == 1 ? "s" : "", Seconds(moved.to_ns), Seconds(moved.from_ns), TimeOrigin()));
  }
}

Status SensorRun::CommitStep(const ClosedStep& step) {
  if (store_ == nullptr) {
    FOVEA_RETURN_IF_ERROR(CreateStore());
  } else if (report_.steps == 0) {
    FOVEA_RETURN_IF_ERROR(CheckGoesOn(step));
    OrderFieldsAsRead();
  }
  FOVEA_RETURN_IF_ERROR(store_->Write(step, options_.fill));
  FOVEA_RETURN_IF_ERROR(store_->Publish());
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
