#ifndef SERVICE_WIRE_READINGS_H_
#define SERVICE_WIRE_READINGS_H_

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/sensors/pull_push.h"
#include "engine/sensors/reading_binner.h"
#include "fovea/v1/ingest.pb.h"

/// Live sensor readings as plain structs, checked: all errors are INVALID_ARGUMENT and point at the
/// field. Thread-safe.
namespace fovea::wire {

/// Of one message of StreamReadings, encoded.
inline constexpr int64_t kMaxReadingsMessageBytes = int64_t{512} << 10;

/// What the first message of StreamReadings says.
struct ReadingsSpec {
  std::string dataset;
  bool acknowledge_received = false;  // instead of what is committed
  std::vector<std::string> fields;    // may be empty: those of the dataset, or "value"
  std::optional<sensors::VoxelGrid> grid;
  sensors::StepRule steps;  // window_s is there
  sensors::Duplicates duplicates = sensors::Duplicates::kLast;
  double least_value = -std::numeric_limits<double>::infinity();
  double greatest_value = std::numeric_limits<double>::infinity();
  sensors::FillRule fill;
  std::string world_unit, value_unit, clock;
  int64_t chunk_edge = 16;
};

struct ReadingBatch {
  uint64_t sequence = 0;  // at least 1
  std::vector<sensors::Reading> readings;
  std::vector<float> values;  // [reading][field]
  std::optional<int64_t> complete_before_ns;
  bool last = false;
};

/// Whether `name` can be that of a dataset that is made: parts between slashes of [A-Za-z0-9_.-],
/// none beginning with a dot or ending in ".zarr", at most 16 and 255 characters each.
[[nodiscard]] bool IsNewDatasetName(const std::string& name);

[[nodiscard]] StatusOr<ReadingsSpec> FromProto(const v1::ReadingsHeader& proto);
/// `fields`: how many values a reading has.
[[nodiscard]] StatusOr<ReadingBatch> FromProto(const v1::ReadingBatch& proto, int fields);

/// For clients. `spec.steps.on_empty` is not kError.
[[nodiscard]] v1::ReadingsHeader ToProto(const ReadingsSpec& spec);
[[nodiscard]] v1::ReadingBatch ToProto(const ReadingBatch& batch);
/// How many readings of so many values surely fit into one message.
[[nodiscard]] int64_t ReadingsOfOneMessage(int fields);

[[nodiscard]] v1::ReadingCounts ToProto(const sensors::ReadingCounts& counts);
[[nodiscard]] sensors::ReadingCounts FromProto(const v1::ReadingCounts& proto);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_READINGS_H_
