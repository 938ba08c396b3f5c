#ifndef ENGINE_SENSORS_STEP_BUFFER_H_
#define ENGINE_SENSORS_STEP_BUFFER_H_

#include <cstdint>
#include <span>
#include <vector>

namespace fovea::sensors {

/// The voxels of one step that hold readings.
struct MeasuredVoxels {
  std::vector<uint64_t> keys;              // Morton keys, ascending, each once
  std::vector<uint32_t> readings;          // in each voxel, duplicates left out
  std::vector<std::vector<float>> values;  // [channel][voxel]: the mean of its readings
  int64_t duplicates = 0;                  // readings that another one replaced
};

/// What becomes of readings of the same place and time.
enum class Duplicates {
  kLast,  // the one that came last stands
  kMean,  // each counts
};

/// The readings of one step, in the order in which they came. Not thread-safe.
class StepBuffer {
 public:
  StepBuffer(int channels, Duplicates duplicates) : channels_(channels), duplicates_(duplicates) {}

  /// `identity` is the same for readings of the same place and time, and for no others.
  /// `values`: one a channel.
  void Add(uint64_t key, uint64_t identity, const float* values) {
    keys_.push_back(key);
    identities_.push_back(identity);
    values_.insert(values_.end(), values, values + channels_);
  }
  [[nodiscard]] int64_t size() const { return static_cast<int64_t>(keys_.size()); }

  /// Sorts and averages. The result depends on the order of readings only through rounding, and
  /// through which of several duplicates came last.
  [[nodiscard]] MeasuredVoxels Measure() const;

 private:
  int channels_;
  Duplicates duplicates_;
  std::vector<uint64_t> keys_, identities_;
  std::vector<float> values_;  // [reading][channel]
};

}  // namespace fovea::sensors

#endif  // ENGINE_SENSORS_STEP_BUFFER_H_
