#ifndef INGEST_SENSORS_SENSOR_STORE_H_
#define INGEST_SENSORS_SENSOR_STORE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/sensors/pull_push.h"
#include "engine/sensors/reading_binner.h"
#include "engine/store/dataset_writer.h"

namespace fovea::ingest {

/// The field that says where values were measured.
inline constexpr const char* kCoverageField = "coverage";

/// What a store of readings is made of.
struct SensorStoreSpec {
  sensors::VoxelGrid grid;
  std::vector<std::string> fields;  // of the channels, without coverage; at least one
  std::string world_unit, value_unit, clock;
  int64_t chunk_edge = 16;
};

/// Steps that lie at a later time than their readings, because the step before does.
struct MovedTimes {
  int64_t steps = 0;
  int64_t from_ns = 0, to_ns = 0;  // of the first of them
};

/// The store that steps of readings are written to: fills their voxels and coverage. Holds the
/// store's lock. Not thread-safe.
class SensorStore {
 public:
  /// Errors as of DatasetWriter::Create.
  [[nodiscard]] static StatusOr<std::unique_ptr<SensorStore>> Create(const std::string& path,
                                                                     const SensorStoreSpec& spec);
  /// One that is there. FAILED_PRECONDITION if another writes to it, or it does not hold haar
  /// float32 fields and a coverage.
  [[nodiscard]] static StatusOr<std::unique_ptr<SensorStore>> Append(const std::string& path);

  [[nodiscard]] const sensors::VoxelGrid& grid() const { return grid_; }
  [[nodiscard]] const std::vector<std::string>& fields() const { return fields_; }  // of channels
  [[nodiscard]] int64_t committed_steps() const { return writer_->info().committed_steps; }
  /// From now on channels come in this order. FAILED_PRECONDITION, saying which fields there are,
  /// unless these are the same.
  [[nodiscard]] Status OrderFields(const std::vector<std::string>& fields);
  /// Of the last step, whether written now or before; absent without one.
  [[nodiscard]] std::optional<int64_t> last_time_ns() const { return last_time_ns_; }
  [[nodiscard]] std::optional<int64_t> last_frame_number() const { return last_frame_; }
  /// The first window behind the last step, if there is one.
  [[nodiscard]] std::optional<int64_t> NextWindow(double start_s, double window_s) const;

  [[nodiscard]] const MovedTimes& moved() const { return moved_; }
  /// What time 0 is, as far as the store says.
  [[nodiscard]] const std::string& clock() const { return writer_->info().clock; }

  /// Writes a step behind the others; visible and safe with the next Publish. Times of a store
  /// never decrease: a step of an earlier time gets that of the step before, and is counted in
  /// `moved`. RESOURCE_EXHAUSTED for a full disk, or voxels so scattered that they need a quarter
  /// of the machine's memory.
  [[nodiscard]] Status Write(const sensors::ClosedStep& step, const sensors::FillRule& fill);
  /// Commits what was written. After an error the store is of no more use.
  [[nodiscard]] Status Publish();

  /// Milliseconds so far: pull-push; files and their flushes.
  [[nodiscard]] double fill_ms() const { return fill_ms_; }
  [[nodiscard]] double write_ms() const { return write_ms_; }

 private:
  SensorStore() = default;
  [[nodiscard]] Status ReadFields(const std::string& path);
  [[nodiscard]] Status CheckBricks(const sensors::ClosedStep& step) const;
  [[nodiscard]] Status WriteOne(const std::string& name, const sensors::FilledField& field);

  std::unique_ptr<store::DatasetWriter> writer_;
  sensors::VoxelGrid grid_;
  std::vector<std::string> fields_;
  std::optional<int64_t> last_time_ns_, last_frame_;
  MovedTimes moved_;
  double fill_ms_ = 0, write_ms_ = 0;
};

/// How many readings may wait in memory before it takes a quarter of the machine's.
[[nodiscard]] int64_t MostPendingReadings(int channels);

}  // namespace fovea::ingest

#endif  // INGEST_SENSORS_SENSOR_STORE_H_
