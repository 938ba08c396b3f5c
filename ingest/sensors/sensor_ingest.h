#ifndef INGEST_SENSORS_SENSOR_INGEST_H_
#define INGEST_SENSORS_SENSOR_INGEST_H_

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/sensors/density.h"
#include "engine/sensors/pull_push.h"
#include "engine/sensors/reading_binner.h"
#include "ingest/sensors/reading_parser.h"
#include "ingest/sensors/sensor_store.h"

/// Files and streams of sensor readings to a coefficient store (docs/sensors.md).
namespace fovea::ingest {

/// The box of the voxels and their sizes, in world units; what is absent follows from the others
/// and from the readings.
struct SensorBox {
  std::optional<std::array<Vec3, 2>> bounds;
  std::optional<Vec3> voxel;  // not with dims
  std::optional<Int3> dims;
};

enum class StepsBy {
  kFile,    // each input is a step
  kWindow,  // windows of time
  kKey,     // ReadingColumns::step
};

struct SensorOptions {
  std::vector<std::string> inputs;      // files, globs, sequences; "-": standard input, alone
  std::string output;                   // NAME.zarr
  std::optional<ReadingFormat> format;  // default: by the name's ending, else by the first byte
  ReadingColumns columns;
  char separator = 0;
  double time_unit_s = 1;
  int64_t max_bad = 0;
  std::vector<std::string> fields;  // of the channels; empty: as the input calls them
  SensorBox box;
  StepsBy steps_by = StepsBy::kFile;
  sensors::StepRule steps;  // window_s only with kWindow
  double least_value = -std::numeric_limits<double>::infinity();
  double greatest_value = std::numeric_limits<double>::infinity();
  sensors::Duplicates duplicates = sensors::Duplicates::kLast;
  sensors::FillRule fill;
  std::string world_unit, value_unit, clock;  // value_unit: of all channels
  int64_t chunk_edge = 16;
  bool append = false;
};

struct SensorReport {
  int64_t steps = 0;  // committed by this call
  sensors::ReadingCounts counts;
  int64_t bad_lines = 0;
  std::string first_bad_line;
  sensors::VoxelGrid grid;
  bool box_was_chosen = false;      // something of SensorBox followed from the readings
  std::vector<std::string> fields;  // without coverage
  uint64_t input_bytes = 0;
  sensors::Density density;     // of the step with most voxels
  int64_t measured_voxels = 0;  // of that step
  std::vector<std::string> warnings;
  bool interrupted = false;
  /// Reading and parsing; sorting into voxels; pull-push; files and their flushes.
  double read_ms = 0, bin_ms = 0, fill_ms = 0, write_ms = 0;
};

struct SensorProgress {
  int64_t steps = 0;
  int64_t readings = 0;
  std::string now;  // the input in hand
};

/// Reads all inputs in their order and commits each step as it closes. Without a box the inputs
/// are read twice, the first time for their extent. `progress` is called between blocks of
/// readings, and at least every 0.2 s while a stream is silent; if it returns false, steps that are
/// not complete are dropped, and counted. Committed steps stay, whatever happens later. Errors name
/// input, line, and what to do. Not to be called for one store at the same time.
[[nodiscard]] StatusOr<SensorReport> IngestSensors(
    const SensorOptions& options, const std::function<bool(const SensorProgress&)>& progress);

}  // namespace fovea::ingest

#endif  // INGEST_SENSORS_SENSOR_INGEST_H_
