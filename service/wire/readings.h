#ifndef SERVICE_WIRE_READINGS_H_
#define SERVICE_WIRE_READINGS_H_

#include <cstdint>
#include <string>

#include "engine/base/status.h"
#include "engine/sensors/reading_binner.h"
#include "fovea/v1/ingest.pb.h"
#include "service/wire/readings_spec.h"

/// Messages of live sensor readings to plain structs and back, checked: all errors are
/// INVALID_ARGUMENT and point at the field. Thread-safe.
namespace fovea::wire {

/// Of one message of StreamReadings, encoded.
inline constexpr int64_t kMaxReadingsMessageBytes = int64_t{512} << 10;

/// Whether `name` can be that of a dataset that is made: parts between slashes of [A-Za-z0-9_.-],
/// none beginning with a dot or ending in ".zarr", at most 16 and 255 characters each.
[[nodiscard]] bool IsNewDatasetName(const std::string& name);

[[nodiscard]] StatusOr<ReadingsSpec> FromProto(const v1::ReadingsHeader& proto);
/// `fields`: how many values a reading has.
[[nodiscard]] StatusOr<ReadingBatch> FromProto(const v1::ReadingBatch& proto, int fields);

/// For clients.
[[nodiscard]] v1::ReadingsHeader ToProto(const ReadingsSpec& spec);
[[nodiscard]] v1::ReadingBatch ToProto(const ReadingBatch& batch);
/// How many readings of so many values surely fit into one message.
[[nodiscard]] int64_t ReadingsOfOneMessage(int fields);

[[nodiscard]] v1::ReadingCounts ToProto(const sensors::ReadingCounts& counts);
[[nodiscard]] sensors::ReadingCounts FromProto(const v1::ReadingCounts& proto);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_READINGS_H_
