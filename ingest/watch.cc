#include "ingest/watch.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset.h"
#include "ingest/file_arrivals.h"
#include "ingest/given.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;
using ProgressCallback = std::function<bool(const IngestProgress&)>;

class Watcher {
 public:
  Watcher(IngestOptions options, const WatchOptions& watch, const ProgressCallback& progress)
      : options_(std::move(options)), watch_(watch), progress_(progress) {}

  StatusOr<IngestReport> Run();

 private:
  Status Prepare();
  Status GoOnBehindDataset();
  Status FindLastStep();
  /// The files that come next, as far as there is no gap that is still waited for.
  StatusOr<std::vector<SequenceFile>> Ready();
  StatusOr<bool> CrossGap(int64_t number, int64_t stride, std::vector<SequenceFile>* ready);
  [[nodiscard]] int64_t Stride() const;
  Status Take(std::vector<SequenceFile> files);
  Status TakeAll(std::vector<SequenceFile> files);
  void LeaveOutLateFiles();
  [[nodiscard]] std::string PathOf(int64_t number) const;
  bool Tell(const IngestProgress& progress) { return progress_ == nullptr || progress_(progress); }

  IngestOptions options_;
  const WatchOptions& watch_;
  const ProgressCallback& progress_;
  std::string input_, folder_, series_;
  std::unique_ptr<FileArrivals> arrivals_;
  std::set<int64_t> numbers_;              // taken, or left out
  std::set<int64_t> held_;                 // of them: the step before stands in for the file
  std::optional<int64_t> last_;            // taken
  std::optional<SequenceFile> last_file_;  // that was taken by this call
  std::optional<Stopwatch> gap_;           // since when a number is waited for
  bool is_stopped_ = false;                // by progress
  IngestReport report_;
};

/// The number of the last step of the dataset that there is.
Status Watcher::GoOnBehindDataset() {
  std::error_code error;
  if (!fs::exists(options_.output, error) || fs::is_empty(options_.output, error)) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(options_.output));
  const store::DatasetInfo info = dataset->info();
  const bool is_ours = info.source && info.source->steps == 0 && info.source->series == series_;
  if (!is_ours && !options_.append) {
    return AlreadyExists(
        "'{}' is there already, and was not begun with --watch and '{}': remove it, name another, "
        "or add to it (--append)",
        options_.output, input_);
  }
  options_.append = info.committed_steps > 0 || options_.append;
  options_.retain.clear();  // the dataset has its own
  options_.extent.reset();
  options_.tolerance.reset();
  FOVEA_RETURN_IF_ERROR(FindLastStep());
  if (last_) {
    report_.warnings.push_back(
        fmt::format("going on behind frame {} of '{}'", *last_, options_.output));
  }
  return absl::OkStatus();
}

/// What number the last step of the dataset has, if there is a dataset.
Status Watcher::FindLastStep() {
  std::error_code error;
  if (!fs::exists(options_.output, error) || fs::is_empty(options_.output, error)) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(options_.output));
  const store::DatasetInfo info = dataset->info();
  for (int64_t step = std::max<int64_t>(0, info.committed_steps - 2); step < info.committed_steps;
       ++step) {
    FOVEA_ASSIGN_OR_RETURN(const std::optional<int64_t> number, dataset->FrameNumber(step));
    if (number) {
      numbers_.insert(*number);
      last_ = *number;
    }
  }
  return absl::OkStatus();
}

Status Watcher::Prepare() {
  if (options_.inputs.size() != 1) {
    return InvalidArgument("--watch takes one series, such as 'smoke.####.vdb': {} were named",
                           options_.inputs.size());
  }
  input_ = options_.inputs.front();
  const fs::path parent = fs::path(input_).parent_path();
  folder_ = parent.empty() ? "." : parent.string();
  FOVEA_ASSIGN_OR_RETURN(std::optional<NamePattern> pattern,
                         NamePattern::Parse(fs::path(input_).filename().string()));
  if (!pattern) {
    return InvalidArgument(
        "--watch: '{}' has no place for a number: name the series with #### or %04d", input_);
  }
  std::error_code error;
  if (!fs::is_directory(folder_, error)) {
    return NotFound("--watch: there is no folder '{}' to watch", folder_);
  }
  series_ = IdentityOf("watch:" + fs::path(input_).filename().string());
  FOVEA_RETURN_IF_ERROR(GoOnBehindDataset());
  arrivals_ = std::make_unique<FileArrivals>(folder_, *std::move(pattern));
  if (!arrivals_->is_told()) {
    report_.warnings.push_back(
        fmt::format("'{}' cannot be watched by the kernel: it is looked through every {} s",
                    folder_, watch_.poll_seconds));
  }
  return absl::OkStatus();
}

std::string Watcher::PathOf(int64_t number) const {
  const fs::path parent = fs::path(input_).parent_path();
  return (parent / arrivals_->finished().at(number)).string();
}

/// The smallest distance between two numbers that were seen; 0 if there are no two.
int64_t Watcher::Stride() const {
  std::set<int64_t> all = numbers_;
  for (const auto& [number, name] : arrivals_->finished()) {
    all.insert(number);
  }
  int64_t stride = 0;
  for (auto at = all.begin(); at != all.end() && std::next(at) != all.end(); ++at) {
    const int64_t distance = *std::next(at) - *at;
    stride = stride == 0 ? distance : std::min(stride, distance);
  }
  return stride;
}

void Watcher::LeaveOutLateFiles() {
  for (const auto& [number, name] : arrivals_->finished()) {
    const bool is_late =
        last_ && number < *last_ && (numbers_.insert(number).second || held_.erase(number) > 0);
    if (is_late && last_file_) {
      report_.warnings.push_back(
          fmt::format("'{}' came after a later one was taken, and is left out", name));
    }
  }
}

/// Whether to go on with `number`, before which some are missing; adds what stands in for them.
StatusOr<bool> Watcher::CrossGap(int64_t number, int64_t stride, std::vector<SequenceFile>* ready) {
  if (!gap_) {
    gap_.emplace();
  }
  const int64_t missing = (ready->empty() ? *last_ : *ready->back().frame_number) + stride;
  if (!ready->empty() || gap_->ElapsedMs() < 1000 * watch_.gap_seconds) {
    return false;
  }
  if (options_.on_missing == OnMissing::kError) {
    return NotFound(
        "number {} of '{}' did not come within {} s, but '{}' did (--on-missing skip or hold goes "
        "on without it; --gap-seconds waits longer)",
        missing, input_, watch_.gap_seconds, arrivals_->finished().at(number));
  }
  const int64_t steps = (number - missing - 1) / stride + 1;
  const bool held_over = options_.on_missing == OnMissing::kHold && last_file_;
  (held_over ? report_.steps_held : report_.steps_skipped) += steps;
  report_.warnings.push_back(fmt::format("there are no files of numbers {} to {}: {}", missing,
                                         missing + (steps - 1) * stride,
                                         held_over ? "the step before stands in" : "left out"));
  if (held_over) {
    for (int64_t held = missing; held < number; held += stride) {
      ready->push_back(*last_file_);
      ready->back().frame_number = held;
      held_.insert(held);
    }
  }
  gap_.reset();
  return true;
}

StatusOr<std::vector<SequenceFile>> Watcher::Ready() {
  LeaveOutLateFiles();
  const int64_t stride = Stride();
  std::vector<SequenceFile> ready;
  for (const auto& [number, name] : arrivals_->finished()) {
    if (last_ && number <= *last_) {
      continue;
    }
    const std::optional<int64_t> before =
        ready.empty() ? last_ : std::optional<int64_t>(*ready.back().frame_number);
    if (before && stride > 0 && number - *before > stride) {
      FOVEA_ASSIGN_OR_RETURN(const bool goes_on, CrossGap(number, stride, &ready));
      if (!goes_on) {
        return ready;
      }
    }
    gap_.reset();
    FOVEA_ASSIGN_OR_RETURN(std::vector<SequenceFile> file,
                           ResolveInputs({PathOf(number)}, OnMissing::kError));
    file.front().frame_number = number;
    ready.push_back(std::move(file.front()));
    if (!options_.append) {
      return ready;  // the extent is that of the first file, whatever came at the same time
    }
  }
  return ready;
}

Status Watcher::Take(std::vector<SequenceFile> files) {
  Given given;
  given.files = std::move(files);
  given.open_series = series_;
  const int64_t before = report_.steps;
  const auto progress = [&](const IngestProgress& now) {
    report_.steps = before + now.steps_done;
    is_stopped_ = !Tell({before + now.steps_done, before + now.steps_total, now.now});
    return !is_stopped_;
  };
  StatusOr<IngestReport> some = IngestGiven(options_, given, progress);
  if (is_stopped_ && absl::IsCancelled(some.status())) {
    return absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(some.status());
  report_.steps = before + some->steps;
  report_.steps_held += some->steps_held;
  report_.steps_skipped += some->steps_skipped;
  report_.dims = some->dims;
  report_.origin = some->origin;
  report_.fields = some->fields;
  report_.input_bytes += some->input_bytes;
  report_.nonfinite_values += some->nonfinite_values;
  report_.read_ms += some->read_ms;
  report_.transform_ms += some->transform_ms;
  report_.write_ms += some->write_ms;
  for (std::string& warning : some->warnings) {
    report_.warnings.push_back(std::move(warning));
  }
  for (const SequenceFile& file : given.files) {
    numbers_.insert(*file.frame_number);
  }
  last_ = given.files.back().frame_number;
  last_file_ = given.files.back();
  options_.append = true;
  options_.retain.clear();
  options_.extent.reset();
  options_.tolerance.reset();
  return absl::OkStatus();
}

/// All of them; if one is bad, those before it all the same.
Status Watcher::TakeAll(std::vector<SequenceFile> files) {
  const Status status = Take(files);
  if (status.ok() || files.size() == 1) {
    return status;
  }
  FOVEA_RETURN_IF_ERROR(FindLastStep());
  for (SequenceFile& file : files) {
    if (!last_ || *file.frame_number > *last_) {
      FOVEA_RETURN_IF_ERROR(Take({std::move(file)}));
    }
  }
  return status;
}

StatusOr<IngestReport> Watcher::Run() {
  FOVEA_RETURN_IF_ERROR(Prepare());
  FOVEA_RETURN_IF_ERROR(arrivals_->Wait(0, /*look=*/true));
  Stopwatch idle;
  Stopwatch since_look;
  while (!is_stopped_ && !(watch_.idle_seconds && idle.ElapsedMs() > 1000 * *watch_.idle_seconds)) {
    constexpr double kShortestWait = 0.05;  // what a progress callback that says stop waits for
    const bool look = since_look.ElapsedMs() >= 1000 * watch_.poll_seconds;
    if (look) {
      static_cast<void>(since_look.RestartMs());
    }
    FOVEA_RETURN_IF_ERROR(arrivals_->Wait(look ? 0 : kShortestWait, look));
    FOVEA_ASSIGN_OR_RETURN(std::vector<SequenceFile> ready, Ready());
    if (!ready.empty()) {
      FOVEA_RETURN_IF_ERROR(
          Annotate(TakeAll(std::move(ready)), fmt::format("after {} steps", report_.steps)));
      static_cast<void>(idle.RestartMs());
    }
    is_stopped_ = is_stopped_ || !Tell({report_.steps, report_.steps, "waiting for " + input_});
  }
  return std::move(report_);
}

}  // namespace

StatusOr<IngestReport> Watch(const IngestOptions& options, const WatchOptions& watch,
                             const ProgressCallback& progress) {
  return Watcher(options, watch, progress).Run();
}

}  // namespace fovea::ingest
