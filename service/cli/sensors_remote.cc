#include "service/cli/sensors_remote.h"

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "engine/base/stopwatch.h"
#include "ingest/grid_choice.h"
#include "ingest/sensors/reading_stream.h"
#include "ingest/sensors/voxel_box.h"
#include "service/cli/console.h"
#include "service/client/client.h"

namespace fovea::cli {
namespace {

StatusOr<client::ReadingsSpec> SpecOf(const ingest::SensorOptions& options,
                                      const std::vector<std::string>& value_names) {
  client::ReadingsSpec spec;
  spec.dataset = options.output;
  for (const std::string& name : options.fields.empty() ? value_names : options.fields) {
    spec.fields.push_back(ingest::FieldNameOf(name));
  }
  if (ingest::IsComplete(options.box)) {
    FOVEA_ASSIGN_OR_RETURN(spec.grid, ingest::ChooseVoxels(options.box, {}));
  }
  spec.steps = options.steps;
  spec.duplicates = options.duplicates;
  spec.least_value = options.least_value;
  spec.greatest_value = options.greatest_value;
  spec.fill = options.fill;
  spec.world_unit = options.world_unit;
  spec.value_unit = options.value_unit;
  spec.clock = options.clock;
  spec.chunk_edge = options.chunk_edge;
  return spec;
}

struct Sent {
  client::SendingReport report;
  int64_t bad_lines = 0;
  std::string first_bad_line;
  bool interrupted = false;
};

/// Reads all inputs; what is complete when this is stopped stays.
StatusOr<Sent> ReadAndSend(const SensorsCommand& command, client::Client& server,
                           Progress* progress) {
  const ingest::SensorOptions& options = command.ingest;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> inputs, ingest::FindInputs(options));
  std::mutex mutex;  // of `progress`
  std::unique_ptr<client::ReadingSender> sender;
  ingest::StreamState state;
  const auto on_held = [&](const client::HeldBack& held) {
    const std::lock_guard lock(mutex);
    progress->Update(held.committed_steps, -1,
                     fmt::format("{} batches safe; held back by the token's quota of bytes in, "
                                 "for {} now",
                                 held.acknowledged, HumanSeconds(held.seconds)));
    return !Interrupted();
  };
  const auto go_on = [&](const std::string& input) {
    if (sender != nullptr) {
      const client::SendingReport now = sender->report();
      const std::lock_guard lock(mutex);
      progress->Update(
          now.committed_steps, -1,
          fmt::format("{} of {} batches safe, {}", now.acknowledged, now.batches, input));
    }
    return !Interrupted();
  };
  const auto on_block = [&](size_t /*index*/, ingest::ReadingBlock* block) -> Status {
    if (sender == nullptr) {
      FOVEA_ASSIGN_OR_RETURN(const client::ReadingsSpec spec, SpecOf(options, state.value_names));
      FOVEA_ASSIGN_OR_RETURN(sender, server.SendReadings(spec, on_held));
    }
    return sender->Send(block->readings, block->values);
  };
  Status status = ingest::ReadAll(options, inputs, go_on, on_block, &state);
  if (status.ok() && sender == nullptr && !state.interrupted) {
    status = FailedPrecondition("there is not one reading; look at --columns");
  }
  if (status.ok() && sender != nullptr && !state.interrupted) {
    status = sender->Finish();
  }
  if (absl::IsCancelled(status) && Interrupted()) {
    state.interrupted = true;
    status = absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(status);
  return Sent{sender == nullptr ? client::SendingReport() : sender->report(), state.bad.count,
              state.bad.first, state.interrupted};
}

nlohmann::json ToJson(const SensorsCommand& command, const Sent& sent, double total_ms) {
  const sensors::ReadingCounts& c = sent.report.counts;
  return {{"dataset", command.ingest.output}, {"steps", sent.report.committed_steps},
          {"batches", sent.report.batches},   {"acknowledged", sent.report.acknowledged},
          {"resumed", sent.report.resumed},   {"interrupted", sent.interrupted},
          {"readings", CountsToJson(c)},      {"bad_lines", sent.bad_lines},
          {"empty_windows", c.empty_windows}, {"total_ms", total_ms}};
}

}  // namespace

Status SendSensors(const SensorsCommand& command) {
  const Stopwatch watch;
  FOVEA_ASSIGN_OR_RETURN(const auto server,
                         client::Client::Connect(*command.server, command.credentials));
  StatusOr<Sent> sent = [&] {
    Progress progress(command.output, "sensors", "steps");
    return ReadAndSend(command, *server, &progress);
  }();
  FOVEA_RETURN_IF_ERROR(sent.status());
  const double ms = watch.ElapsedMs();
  if (command.output.json) {
    PrintJson(ToJson(command, *sent, ms));
    return absl::OkStatus();
  }
  ingest::SensorReport report;
  report.counts = sent->report.counts;
  report.bad_lines = sent->bad_lines;
  PrintLine(fmt::format("{}: {} readings to {} in {}; {} there", command.ingest.output,
                        report.counts.used, *command.server, HumanSeconds(ms / 1000),
                        CountOf(sent->report.committed_steps, "step")));
  if (const std::string left_out = LeftOut(report); !left_out.empty()) {
    PrintLine(fmt::format("left out: {}", left_out));
  }
  if (sent->report.resumed > 0) {
    Note(command.output,
         fmt::format("note: the connection was lost {} times; what was sent again counts as late "
                     "where its step was committed",
                     sent->report.resumed));
  }
  return absl::OkStatus();
}

nlohmann::json CountsToJson(const sensors::ReadingCounts& counts) {
  return {{"read", counts.read},
          {"used", counts.used},
          {"duplicates", counts.duplicates},
          {"not_finite", counts.not_finite},
          {"out_of_range", counts.out_of_range},
          {"outside", counts.outside},
          {"late", counts.late},
          {"ahead", counts.ahead},
          {"incomplete", counts.pending}};
}

}  // namespace fovea::cli
