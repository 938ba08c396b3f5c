#include "engine/sensors/reading_binner.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "engine/sensors/morton.h"
#include "engine/sensors/pull_push.h"

namespace fovea::sensors {
namespace {

/// Times whose nanoseconds fit 64 bits.
constexpr double kLatest = 9.2e9;

/// The same for the same place and time. Others differ, but for one pair in 2^64.
uint64_t IdentityOf(const Reading& reading) {
  uint64_t mixed = 0;
  for (const double part : {reading.x, reading.y, reading.z, reading.time_s}) {
    // + 0.0: -0 is 0. Steps of splitmix64.
    mixed = (mixed ^ std::bit_cast<uint64_t>(part + 0.0)) + 0x9e3779b97f4a7c15ULL;
    mixed = (mixed ^ (mixed >> 30)) * 0xbf58476d1ce4e5b9ULL;
    mixed = (mixed ^ (mixed >> 27)) * 0x94d049bb133111ebULL;
    mixed ^= mixed >> 31;
  }
  return mixed;
}

bool IsTime(double seconds) {
  return std::abs(seconds) <= kLatest;
}

int64_t Nanoseconds(double seconds) {
  return static_cast<int64_t>(std::llround(std::clamp(seconds, -kLatest, kLatest) * 1e9));
}

}  // namespace

Matrix4 VoxelGrid::IndexToWorld() const {
  Matrix4 matrix;
  for (int axis = 0; axis < 3; ++axis) {
    matrix.m[5 * axis] = voxel[axis];
    matrix.m[4 * axis + 3] = lower[axis];
  }
  return matrix;
}

StatusOr<ReadingBinner> ReadingBinner::Make(const BinnerOptions& options, OnStep on_step) {
  const StepRule& steps = options.steps;
  if (steps.window_s && !(*steps.window_s >= 1e-9 && *steps.window_s <= kLatest)) {
    return InvalidArgument("a window of {} seconds: must be 1e-9 to {}", *steps.window_s, kLatest);
  }
  if (!IsTime(steps.start_s)) {
    return InvalidArgument("the first window starts at {} s: must be within +-{}", steps.start_s,
                           kLatest);
  }
  if (!(steps.watermark_s >= 0 && steps.watermark_s <= kLatest)) {
    return InvalidArgument("a watermark of {} seconds: must be 0 to {}", steps.watermark_s,
                           kLatest);
  }
  if (steps.most_ahead < 1 || options.channels < 1) {
    return InvalidArgument("windows ahead and channels must be at least 1, not {} and {}",
                           steps.most_ahead, options.channels);
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (!(options.grid.voxel[axis] > 0) || !std::isfinite(options.grid.voxel[axis]) ||
        !std::isfinite(options.grid.lower[axis])) {
      return InvalidArgument("voxels of size {} from {} on: sizes must be more than 0",
                             options.grid.voxel[axis], options.grid.lower[axis]);
    }
  }
  ReadingBinner binner(options, std::move(on_step));
  if (steps.first_window) {
    binner.next_window_ = *steps.first_window;
    binner.last_window_ = *steps.first_window - 1;
  }
  return binner;
}

std::optional<uint64_t> ReadingBinner::Voxel(const Reading& reading, const float* values) {
  for (int channel = 0; channel < options_.channels; ++channel) {
    if (!(std::abs(values[channel]) <= kLargestValue)) {
      ++counts_.not_finite;
      return std::nullopt;
    }
  }
  if (!std::isfinite(reading.x + reading.y + reading.z) || !IsTime(reading.time_s)) {
    ++counts_.not_finite;
    return std::nullopt;
  }
  for (int channel = 0; channel < options_.channels; ++channel) {
    if (values[channel] < options_.least_value || values[channel] > options_.greatest_value) {
      ++counts_.out_of_range;
      return std::nullopt;
    }
  }
  const VoxelGrid& grid = options_.grid;
  const Int3& dims = grid.hierarchy.dims();
  const Vec3 place{reading.x, reading.y, reading.z};
  Int3 at;
  for (int axis = 0; axis < 3; ++axis) {
    const double voxels = (place[axis] - grid.lower[axis]) / grid.voxel[axis];
    const auto size = static_cast<double>(dims[axis]);
    if (!(voxels >= 0 && voxels <= size)) {
      ++counts_.outside;
      return std::nullopt;
    }
    at[axis] = std::min(static_cast<int64_t>(voxels), dims[axis] - 1);
  }
  return MortonKey(at);
}

Status ReadingBinner::Add(std::span<const Reading> readings, std::span<const float> values) {
  if (values.size() != readings.size() * static_cast<size_t>(options_.channels)) {
    return InvalidArgument("{} values for {} readings of {} channels", values.size(),
                           readings.size(), options_.channels);
  }
  ++calls_;
  const float* of_reading = values.data();
  for (const Reading& reading : readings) {
    ++counts_.read;
    if (const std::optional<uint64_t> key = Voxel(reading, of_reading)) {
      FOVEA_RETURN_IF_ERROR(options_.steps.window_s ? AddByWindow(*key, reading, of_reading)
                                                    : AddByKey(*key, reading, of_reading));
    }
    of_reading += options_.channels;
  }
  return absl::OkStatus();
}

int64_t ReadingBinner::WindowOf(double time_s) const {
  const StepRule& rule = options_.steps;
  const double place = (time_s - rule.start_s) / *rule.window_s;
  // What is meant to stand on a border does, though 0.3 / 0.1 is less than 3.
  const double rounding = 4 * std::numeric_limits<double>::epsilon() *
                          (std::abs(time_s) + std::abs(rule.start_s)) / *rule.window_s;
  const double window = std::floor(place + std::min(rounding, 0.25));
  return static_cast<int64_t>(std::clamp(window, -9e18, 9e18));
}

Status ReadingBinner::AddByWindow(uint64_t key, const Reading& reading, const float* values) {
  const int64_t window = WindowOf(reading.time_s);
  if (window < next_window_) {
    ++counts_.late;
    return absl::OkStatus();
  }
  if (reading.time_s > newest_s_) {
    // The first reading of all has nothing to be compared with.
    if (std::isfinite(newest_s_) && window - WindowOf(newest_s_) > options_.steps.most_ahead) {
      ++counts_.ahead;
      return absl::OkStatus();
    }
    newest_s_ = reading.time_s;
    FOVEA_RETURN_IF_ERROR(CloseWindowsBefore(WindowOf(newest_s_ - options_.steps.watermark_s)));
  }
  return Put(window, key, reading, values);
}

Status ReadingBinner::AddByKey(uint64_t key, const Reading& reading, const float* values) {
  if (closed_keys_.contains(reading.step)) {
    ++counts_.late;
    return absl::OkStatus();
  }
  newest_s_ = std::max(newest_s_, reading.time_s);
  if (!open_.contains(reading.step)) {
    key_order_.push_back(reading.step);
  }
  FOVEA_RETURN_IF_ERROR(Put(reading.step, key, reading, values));
  // The oldest first, so that steps come in order.
  while (key_order_.size() > 1 &&
         newest_s_ >= open_.at(key_order_.front()).last_s + options_.steps.watermark_s) {
    FOVEA_RETURN_IF_ERROR(CloseKey(key_order_.front()));
  }
  return absl::OkStatus();
}

Status ReadingBinner::Put(int64_t step, uint64_t key, const Reading& reading, const float* values) {
  if (counts_.pending >= options_.most_pending) {
    return ResourceExhausted(
        "{} readings wait for their steps to close, more than fit in memory: make steps shorter, "
        "or the watermark",
        counts_.pending);
  }
  if (current_ == nullptr || current_step_ != step) {
    const auto [entry, is_new] =
        open_.try_emplace(step, OpenStep{StepBuffer(options_.channels, options_.duplicates),
                                         reading.time_s, reading.time_s, calls_ - 1});
    current_ = &entry->second;
    current_step_ = step;
  }
  current_->first_s = std::min(current_->first_s, reading.time_s);
  current_->last_s = std::max(current_->last_s, reading.time_s);
  current_->buffer.Add(key, IdentityOf(reading), values);
  ++counts_.pending;
  return absl::OkStatus();
}

Status ReadingBinner::CloseWindowsBefore(int64_t window) {
  while (!open_.empty() && open_.begin()->first < window) {
    const auto step = open_.begin();
    const int64_t closing = step->first;
    FOVEA_RETURN_IF_ERROR(FillGap(closing));
    last_window_ = closing;
    next_window_ = closing + 1;
    const double start =
        options_.steps.start_s + static_cast<double>(closing) * *options_.steps.window_s;
    FOVEA_RETURN_IF_ERROR(Close(step, Nanoseconds(start)));
  }
  next_window_ = std::max(next_window_, window);
  return absl::OkStatus();
}

/// The empty windows between the last step and `window`.
Status ReadingBinner::FillGap(int64_t window) {
  if (!last_window_ || window - *last_window_ <= 1) {
    return absl::OkStatus();
  }
  const StepRule& rule = options_.steps;
  counts_.empty_windows += window - *last_window_ - 1;
  if (rule.on_empty == OnEmpty::kError) {
    return FailedPrecondition(
        "there are no readings from {} s on for {} windows of {} s",
        rule.start_s + static_cast<double>(*last_window_ + 1) * *rule.window_s,
        window - *last_window_ - 1, *rule.window_s);
  }
  if (rule.on_empty == OnEmpty::kHold && last_) {
    for (int64_t empty = *last_window_ + 1; empty < window; ++empty) {
      last_->frame_number = empty;
      last_->time_ns = Nanoseconds(rule.start_s + static_cast<double>(empty) * *rule.window_s);
      last_->held = true;
      FOVEA_RETURN_IF_ERROR(on_step_(*last_));
    }
  }
  return absl::OkStatus();
}

Status ReadingBinner::CloseKey(int64_t key) {
  const auto step = open_.find(key);
  closed_keys_.insert(key);
  std::erase(key_order_, key);
  return Close(step, Nanoseconds(step->second.first_s));
}

Status ReadingBinner::Close(std::map<int64_t, OpenStep>::iterator step, int64_t time_ns) {
  ClosedStep closed;
  closed.time_ns = time_ns;
  closed.frame_number = step->first;
  const int64_t readings = step->second.buffer.size();
  closed.voxels = step->second.buffer.Measure();
  open_.erase(step);
  current_ = nullptr;
  const Status status = on_step_(closed);
  if (status.ok()) {
    counts_.pending -= readings;
    counts_.duplicates += closed.voxels.duplicates;
    counts_.used += readings - closed.voxels.duplicates;
    if (options_.steps.on_empty == OnEmpty::kHold) {
      last_ = std::move(closed);
    }
  }
  return status;
}

Status ReadingBinner::CloseBefore(double time_s) {
  return IsTime(time_s) ? CloseWindowsBefore(WindowOf(time_s)) : absl::OkStatus();
}

int64_t ReadingBinner::SettledCalls() const {
  int64_t settled = calls_;
  for (const auto& [step, open] : open_) {
    settled = std::min(settled, open.first_call);
  }
  return settled;
}

Status ReadingBinner::Finish() {
  if (options_.steps.window_s) {
    return open_.empty() ? absl::OkStatus() : CloseWindowsBefore(open_.rbegin()->first + 1);
  }
  while (!key_order_.empty()) {
    FOVEA_RETURN_IF_ERROR(CloseKey(key_order_.front()));
  }
  return absl::OkStatus();
}

}  // namespace fovea::sensors
