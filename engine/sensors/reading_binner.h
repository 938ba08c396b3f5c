#ifndef ENGINE_SENSORS_READING_BINNER_H_
#define ENGINE_SENSORS_READING_BINNER_H_

#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "engine/sensors/step_buffer.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

namespace fovea::sensors {

/// One reading of a sensor; its values stand beside it.
struct Reading {
  double x = 0, y = 0, z = 0;  // world units
  double time_s = 0;           // seconds of the dataset's clock
  int64_t step = 0;            // the step's key, where steps go by key
};

/// Where voxels lie in the world: voxel i of an axis covers lower + [i, i+1) * voxel, the last one
/// also the upper face of the box.
struct VoxelGrid {
  Vec3 lower;
  Vec3 voxel{1, 1, 1};  // more than 0
  Hierarchy hierarchy;
  [[nodiscard]] Matrix4 IndexToWorld() const;
};

/// What an empty window between two steps becomes.
enum class OnEmpty {
  kSkip,   // nothing; time stamps show the gap
  kHold,   // the step before once more, with a coverage of 0
  kError,  // FAILED_PRECONDITION
};

struct StepRule {
  /// Window k holds start_s + [k, k+1) * window_s; nothing: steps go by Reading::step, in the
  /// order in which their first readings come, each of which has the time of its earliest reading.
  std::optional<double> window_s;
  double start_s = 0;
  std::optional<int64_t> first_window;  // readings before it are late, in whatever order
  /// A window closes with the first reading at or past its end + this; a step by key with the
  /// first reading of another one that is this much later than its own latest.
  double watermark_s = 0;
  /// A reading more windows ahead of the newest one than this is dropped: one broken clock must
  /// not close everything.
  int64_t most_ahead = 1000;
  OnEmpty on_empty = OnEmpty::kSkip;
};

struct BinnerOptions {
  VoxelGrid grid;
  int channels = 1;
  /// Values outside are dropped; NaN and what is beyond kLargestValue always are.
  double least_value = -std::numeric_limits<double>::infinity();
  double greatest_value = std::numeric_limits<double>::infinity();
  Duplicates duplicates = Duplicates::kLast;
  StepRule steps;
  int64_t most_pending = int64_t{1} << 28;  // readings of all open steps
};

/// What became of readings; read = all the others, but `empty_windows`, together.
struct ReadingCounts {
  int64_t read = 0;
  int64_t used = 0;          // in steps that closed
  int64_t duplicates = 0;    // replaced by a later one of the same place and time
  int64_t not_finite = 0;    // a value, place or time is NaN, infinite or too large
  int64_t out_of_range = 0;  // a value outside [least_value, greatest_value]
  int64_t outside = 0;       // of the box
  int64_t late = 0;          // their step was closed
  int64_t ahead = 0;         // too far ahead of all others
  int64_t pending = 0;       // in steps that are still open, or were never closed
  int64_t empty_windows = 0;
};

struct ClosedStep {
  int64_t time_ns = 0;       // the window's start, or the earliest reading's: that may decrease
  int64_t frame_number = 0;  // the window, or the key
  MeasuredVoxels voxels;     // at least one
  bool held = false;         // the voxels are those of the step before: nothing was measured
};

/// Sorts a stream of readings into voxels and steps, and hands out each step as it closes, in
/// order. What comes out depends on the order of the readings only, not on how they are cut into
/// calls. Independent of files. Not thread-safe: one stream, one thread at a time.
class ReadingBinner {
 public:
  using OnStep = std::function<Status(const ClosedStep&)>;

  /// INVALID_ARGUMENT, naming what is wrong, for rules that cannot be.
  [[nodiscard]] static StatusOr<ReadingBinner> Make(const BinnerOptions& options, OnStep on_step);

  /// `values` holds options.channels for each reading. Errors: those of `on_step`;
  /// FAILED_PRECONDITION for an empty window (OnEmpty::kError); RESOURCE_EXHAUSTED for more than
  /// most_pending. After an error the binner is of no more use than for its counts.
  [[nodiscard]] Status Add(std::span<const Reading> readings, std::span<const float> values);
  /// Closes the windows that end at or before `time_s`, whatever the watermark: no more readings of
  /// that time will come. Only by window. Errors as of Add.
  [[nodiscard]] Status CloseBefore(double time_s);
  /// Closes every open step: there will be no more readings.
  [[nodiscard]] Status Finish();

  [[nodiscard]] const ReadingCounts& counts() const { return counts_; }
  /// How many calls of Add, from the first, have all their readings in closed steps, or left out.
  [[nodiscard]] int64_t SettledCalls() const;

 private:
  struct OpenStep {
    StepBuffer buffer;
    double first_s, last_s;  // times of its readings
    int64_t first_call;      // of Add, the earliest that put a reading into it; from 0
  };

  ReadingBinner(const BinnerOptions& options, OnStep on_step)
      : options_(options), on_step_(std::move(on_step)) {}
  /// The reading's voxel, or nothing, counted.
  [[nodiscard]] std::optional<uint64_t> Voxel(const Reading& reading, const float* values);
  [[nodiscard]] Status AddByWindow(uint64_t key, const Reading& reading, const float* values);
  [[nodiscard]] Status AddByKey(uint64_t key, const Reading& reading, const float* values);
  [[nodiscard]] Status Put(int64_t step, uint64_t key, const Reading& reading, const float* values);
  [[nodiscard]] int64_t WindowOf(double time_s) const;
  [[nodiscard]] Status CloseWindowsBefore(int64_t window);
  [[nodiscard]] Status CloseKey(int64_t key);
  [[nodiscard]] Status FillGap(int64_t window);
  [[nodiscard]] Status Close(std::map<int64_t, OpenStep>::iterator step, int64_t time_ns);

  BinnerOptions options_;
  OnStep on_step_;
  ReadingCounts counts_;
  int64_t calls_ = 0;  // of Add
  std::map<int64_t, OpenStep> open_;
  double newest_s_ = -std::numeric_limits<double>::infinity();
  OpenStep* current_ = nullptr;  // where the last reading went; null after any step closed
  int64_t current_step_ = 0;
  // By window.
  int64_t next_window_ = std::numeric_limits<int64_t>::min();  // those before it are closed
  std::optional<int64_t> last_window_;                         // the last step that was handed out
  std::optional<ClosedStep> last_;                             // what it was, to hold
  // By key.
  std::vector<int64_t> key_order_;  // open keys, by first reading
  std::set<int64_t> closed_keys_;
};

}  // namespace fovea::sensors

#endif  // ENGINE_SENSORS_READING_BINNER_H_
