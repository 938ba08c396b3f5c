#ifndef INGEST_SENSORS_READING_STREAM_H_
#define INGEST_SENSORS_READING_STREAM_H_

#include <functional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/sensors/sensor_ingest.h"

namespace fovea::ingest {

/// What the inputs are read with: state that lasts over all of them.
struct StreamState {
  StepKeys keys;
  BadLines bad;
  uint64_t bytes = 0;
  std::vector<std::string> value_names;  // once known
  bool interrupted = false;
};

/// Called with each block of readings of input `index`; may change the readings.
using OnBlock = std::function<Status(size_t index, ReadingBlock* block)>;

/// The files that options.inputs stand for, in order; "-" stays as it is. NOT_FOUND names what is
/// not there.
[[nodiscard]] StatusOr<std::vector<std::string>> FindInputs(const SensorOptions& options);

/// Parses all of `inputs`. `go_on` is asked between blocks, and every 0.2 s while nothing comes.
[[nodiscard]] Status ReadAll(const SensorOptions& options, const std::vector<std::string>& inputs,
                             const std::function<bool(const std::string& input)>& go_on,
                             const OnBlock& on_block, StreamState* state);

}  // namespace fovea::ingest

#endif  // INGEST_SENSORS_READING_STREAM_H_
