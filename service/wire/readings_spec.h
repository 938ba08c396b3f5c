#ifndef SERVICE_WIRE_READINGS_SPEC_H_
#define SERVICE_WIRE_READINGS_SPEC_H_

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "engine/sensors/pull_push.h"
#include "engine/sensors/reading_binner.h"

/// Live sensor readings as plain structs: what StreamReadings carries (proto/fovea/v1/ingest.proto
/// says what each field means).
namespace fovea::wire {

/// What the first message says.
struct ReadingsSpec {
  std::string dataset;
  bool acknowledge_received = false;  // instead of what is committed
  std::vector<std::string> fields;    // may be empty: those of the dataset, or "value"
  std::optional<sensors::VoxelGrid> grid;
  sensors::StepRule steps;  // window_s is there; on_empty is not kError
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

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_READINGS_SPEC_H_
