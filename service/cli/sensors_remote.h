#ifndef SERVICE_CLI_SENSORS_REMOTE_H_
#define SERVICE_CLI_SENSORS_REMOTE_H_

#include <string>

#include <nlohmann/json_fwd.hpp>

#include "ingest/sensors/sensor_ingest.h"
#include "service/cli/commands.h"

namespace fovea::cli {

/// `fovea sensors --server`: reads and parses here, and sends the readings to a server.
[[nodiscard]] Status SendSensors(const SensorsCommand& command);

/// "3 late, 2 outside the box"; empty if none was left out.
[[nodiscard]] std::string LeftOut(const ingest::SensorReport& report);

/// How many readings each rule met.
[[nodiscard]] nlohmann::json CountsToJson(const sensors::ReadingCounts& counts);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_SENSORS_REMOTE_H_
