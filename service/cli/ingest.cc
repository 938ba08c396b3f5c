#include "ingest/ingest.h"

#include <filesystem>

#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"

namespace fovea::cli {
namespace {

void PrintReport(const IngestCommand& command, const ingest::IngestReport& report, double seconds) {
  const double mib = static_cast<double>(report.input_bytes) / (1 << 20);
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.ingest.output},
                              {"steps", report.steps},
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
  std::string fields;
  for (const std::string& field : report.fields) {
    fields += (fields.empty() ? "" : ", ") + field;
  }
  PrintLine(fmt::format("{}: {} steps of {} x {} x {} voxels, fields {}", command.ingest.output,
                        report.steps, report.dims.x, report.dims.y, report.dims.z, fields));
  for (size_t i = 0; i < report.max_errors.size(); ++i) {
    PrintLine(fmt::format("field {}: no voxel is off by more than {:.3g}", report.fields[i],
                          report.max_errors[i]));
  }
  PrintLine(fmt::format(
      "{} read in {} ({:.1f} MiB/s); read {:.0f} ms, transform {:.0f} ms, "
      "write {:.0f} ms",
      HumanBytes(report.input_bytes), HumanSeconds(seconds), mib / std::max(seconds, 1e-9),
      report.read_ms, report.transform_ms, report.write_ms));
}

}  // namespace

Status Run(const IngestCommand& command) {
  const Stopwatch watch;
  const std::filesystem::path folder = std::filesystem::path(command.ingest.output).parent_path();
  std::error_code ignored;  // what cannot be made is reported by the store, with its path
  if (!folder.empty() && !command.ingest.append) {
    std::filesystem::create_directories(folder, ignored);
  }
  StatusOr<ingest::IngestReport> report = [&] {
    Progress progress(command.output, "ingest", "steps");
    return ingest::Ingest(command.ingest, [&](const ingest::IngestProgress& now) {
      progress.Update(now.steps_done, now.steps_total, now.now);
      return !Interrupted();
    });
  }();
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
