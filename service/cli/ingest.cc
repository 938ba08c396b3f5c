#include "ingest/ingest.h"

#include <cmath>
#include <functional>
#include <utility>
#include <variant>

#include <nlohmann/json.hpp>

#include "engine/base/buffers.h"
#include "engine/store/merge.h"
#include "ingest/parts.h"
#include "ingest/watch.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/dataset_output.h"
#include "service/cli/ingest_remote.h"

namespace fovea::cli {
namespace {

/// To three digits, and never below the value.
double RoundedUp(double value) {
  if (!(value > 0)) {
    return value;
  }
  const double unit = std::pow(10, std::floor(std::log10(value)) - 2);
  return std::ceil(value / unit) * unit;
}

void PrintReport(const IngestCommand& command, const ingest::IngestReport& report, double seconds) {
  if (!command.output.json && report.steps_before > 0) {
    PrintLine(fmt::format("{}: {} {} there already", command.ingest.output,
                          CountOf(report.steps_before, "step"),
                          report.steps_before == 1 ? "was" : "were"));
  }
  const double mib = static_cast<double>(report.input_bytes) / (1 << 20);
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.ingest.output},
                              {"steps", report.steps},
                              {"steps_before", report.steps_before},
                              {"steps_held", report.steps_held},
                              {"steps_skipped", report.steps_skipped},
                              {"nx", report.dims.x},
                              {"ny", report.dims.y},
                              {"nz", report.dims.z},
                              {"origin", {report.origin.x, report.origin.y, report.origin.z}},
                              {"fields", report.fields},
                              {"warnings", report.warnings},
                              {"input_bytes", report.input_bytes},
                              {"nonfinite_values", report.nonfinite_values},
                              {"max_errors", report.max_errors},
                              {"read_ms", report.read_ms},
                              {"transform_ms", report.transform_ms},
                              {"write_ms", report.write_ms},
                              {"total_ms", seconds * 1000}}));
    return;
  }
  if (report.steps == 0 && report.steps_before > 0) {
    return;
  }
  if (report.dims.x == 0) {  // --watch
    PrintLine(fmt::format("{}: no file came", command.ingest.output));
    return;
  }
  std::string fields;
  for (const std::string& field : report.fields) {
    fields += (fields.empty() ? "" : ", ") + field;
  }
  PrintLine(fmt::format("{}: {} of {} x {} x {} voxels, fields {}", command.ingest.output,
                        CountOf(report.steps, "step"), report.dims.x, report.dims.y, report.dims.z,
                        fields));
  if (report.steps_held > 0) {
    PrintLine(fmt::format("held: {}, for which the one before stands in",
                          CountOf(report.steps_held, "step")));
  }
  if (report.steps_skipped > 0) {
    PrintLine(fmt::format("skipped: {}, whose file or grid is missing",
                          CountOf(report.steps_skipped, "step")));
  }
  for (size_t i = 0; i < report.max_errors.size(); ++i) {
    PrintLine(fmt::format("field {}: no voxel is off by more than {:.3g}", report.fields[i],
                          RoundedUp(report.max_errors[i])));
  }
  PrintLine(fmt::format(
      "{} read in {} ({:.1f} MiB/s); read {:.0f} ms, transform {:.0f} ms, "
      "write {:.0f} ms",
      HumanBytes(report.input_bytes), HumanSeconds(seconds), mib / std::max(seconds, 1e-9),
      report.read_ms, report.transform_ms, report.write_ms));
}

/// Calls `work` with a callback that shows progress and says when to stop.
template <typename Work>
auto WithProgress(const IngestCommand& command, const char* what, const Work& work) {
  Progress progress(command.output, what, "steps");
  const std::function<bool(const ingest::IngestProgress&)> update =
      [&](const ingest::IngestProgress& now) {
        progress.Update(now.steps_done, now.steps_total, now.now);
        return !Interrupted();
      };
  return work(update);
}

Status MakePlan(const IngestCommand& command) {
  const auto planned = WithProgress(command, "plan", [&](const auto& progress) {
    return ingest::WritePlan(command.ingest, command.arguments, command.plan, progress);
  });
  if (!planned.ok()) {
    return planned.status();
  }
  const Int3 dims = planned->plan.extent.Size();
  if (command.output.json) {
    PrintJson(nlohmann::json({{"plan", command.plan},
                              {"series", planned->series},
                              {"steps", planned->plan.steps.size()},
                              {"nx", dims.x},
                              {"ny", dims.y},
                              {"nz", dims.z},
                              {"fields", planned->plan.fields},
                              {"warnings", planned->plan.warnings}}));
    return absl::OkStatus();
  }
  for (const std::string& warning : planned->plan.warnings) {
    Note(command.output, "note: " + warning);
  }
  // With a tolerance the first step chooses for all: there are no parts.
  const bool in_parts = !command.ingest.tolerance;
  PrintLine(
      fmt::format("{}: {} of {} x {} x {} voxels; `fovea ingest --from-plan {}{} -o NAME.zarr` "
                  "makes {}",
                  command.plan, CountOf(std::ssize(planned->plan.steps), "step"), dims.x, dims.y,
                  dims.z, ShellQuote(command.plan), in_parts ? " --shard i/n" : "",
                  in_parts ? "part i, from 0, of n" : "it, in one piece (--tolerance)"));
  return absl::OkStatus();
}

/// The flags of the command line that the plan was made with.
StatusOr<ingest::IngestOptions> OptionsOf(const ingest::PlanFile& plan, const std::string& path) {
  const ParseResult parsed = ParseCommandLine(plan.arguments);
  const auto* command = parsed.command ? std::get_if<IngestCommand>(&*parsed.command) : nullptr;
  if (command == nullptr || command->plan.empty()) {
    return FailedPrecondition("{} was made by another version of fovea: plan again", path);
  }
  return command->ingest;
}

StatusOr<ingest::IngestReport> MakePart(IngestCommand* command) {
  FOVEA_ASSIGN_OR_RETURN(const ingest::PlanFile plan, ingest::ReadPlan(command->from_plan));
  FOVEA_ASSIGN_OR_RETURN(ingest::IngestOptions options, OptionsOf(plan, command->from_plan));
  options.output = command->ingest.output;
  options.threads = command->ingest.threads;
  options.worker = command->ingest.worker;
  const Shard shard = command->shard.value_or(Shard{});
  auto report = WithProgress(*command, "ingest", [&](const auto& progress) {
    return ingest::IngestPart(options, plan, shard.index, shard.count, progress);
  });
  if (shard.count > 1) {
    command->ingest.output = store::PartPath(options.output, shard.index, shard.count);
  }
  return report;
}

StatusOr<ingest::IngestReport> Make(IngestCommand* command) {
  if (!command->from_plan.empty()) {
    return MakePart(command);
  }
  return WithProgress(*command, "ingest", [&](const auto& progress) {
    return command->watch ? ingest::Watch(command->ingest, command->watching, progress)
                          : ingest::Ingest(command->ingest, progress);
  });
}

}  // namespace

Status Run(const IngestCommand& asked) {
  if (asked.server) {
    return UploadFiles(asked);
  }
  if (!asked.plan.empty()) {
    return MakePlan(asked);
  }
  KeepFreedMemory();
  IngestCommand command = asked;
  const Stopwatch watch;
  if (!command.ingest.append) {
    PrepareOutput(command.output, command.ingest.output);
  }
  const StatusOr<ingest::IngestReport> report = Make(&command);
  if (!report.ok()) {
    return report.status();
  }
  if (!command.output.json) {
    for (const std::string& warning : report->warnings) {
      Note(command.output, "note: " + warning);
    }
  }
  PrintReport(command, *report, watch.ElapsedMs() / 1000);
  return absl::OkStatus();
}

}  // namespace fovea::cli
