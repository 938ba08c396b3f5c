#include "ingest/step_times.h"

#include <cmath>
#include <limits>

namespace fovea::ingest {
namespace {

/// Those that the files say, if all say one and they are in order; else none.
std::vector<double> TimesOfFiles(const std::vector<ScannedFile>& files, const SeriesPlan& plan) {
  std::vector<double> times;
  for (const PlannedStep& step : plan.steps) {
    const FieldSource& source = step.sources.front();
    const FileInfo& file = files[source.file_set].info;
    if (file.times_s.empty()) {
      return {};
    }
    const double time = file.times_s[static_cast<size_t>(source.step_in_file)];
    if (!times.empty() && time <= times.back()) {
      return {};
    }
    times.push_back(time);
  }
  return times;
}

/// Of each step, in seconds: as asked for, as the files say, or by numbers.
StatusOr<std::vector<double>> Times(const IngestOptions& options,
                                    const std::vector<ScannedFile>& files, int64_t first_index,
                                    const SeriesPlan& plan) {
  if (!options.times_s.empty()) {
    if (options.times_s.size() != plan.steps.size()) {
      return InvalidArgument("--times: {} times for {} steps", options.times_s.size(),
                             plan.steps.size());
    }
    return options.times_s;
  }
  const double fps = options.frames_per_second.value_or(24);
  if (!std::isfinite(fps) || fps <= 0) {
    return InvalidArgument("{} frames a second: must be positive", fps);
  }
  if (!options.frames_per_second) {
    std::vector<double> times = TimesOfFiles(files, plan);
    if (!times.empty()) {
      return times;
    }
  }
  std::vector<double> times;
  for (size_t i = 0; i < plan.steps.size(); ++i) {
    const int64_t index = first_index + static_cast<int64_t>(i);
    times.push_back(static_cast<double>(plan.steps[i].frame_number.value_or(index)) / fps);
  }
  return times;
}

}  // namespace

Status SetStepTimes(const IngestOptions& options, const std::vector<ScannedFile>& files,
                    const std::optional<ExistingStore>& existing, SeriesPlan* plan) {
  const int64_t first_index = existing ? existing->info.committed_steps : 0;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<double> times,
                         Times(options, files, first_index, *plan));
  int64_t last = existing && existing->info.committed_steps > 0
                     ? existing->last_time_ns
                     : std::numeric_limits<int64_t>::min();
  for (size_t i = 0; i < plan->steps.size(); ++i) {
    PlannedStep& step = plan->steps[i];
    if (!(std::abs(times[i]) < 9e9)) {
      return InvalidArgument("'{}' would be at {} s, beyond the range of time",
                             step.sources.front().path, times[i]);
    }
    step.time_ns = std::llround(times[i] * 1e9);
    if (step.time_ns < last) {
      return InvalidArgument(
          "'{}' would be at {} s, before the last step{} at {} s: steps are added in order",
          step.sources.front().path, static_cast<double>(step.time_ns) * 1e-9,
          i == 0 ? " of '" + options.output + "'" : "", static_cast<double>(last) * 1e-9);
    }
    last = step.time_ns;
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
