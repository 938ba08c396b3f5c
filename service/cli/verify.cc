#include "engine/store/verify.h"

#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"

namespace fovea::cli {

Status Run(const VerifyCommand& command) {
  const StatusOr<store::VerifyReport> report = [&] {
    Progress progress(command.output, "verify", "steps");
    return store::Verify(command.dataset, command.threads, [&](int64_t done, int64_t total) {
      progress.Update(done, total);
      return !Interrupted();
    });
  }();
  if (!report.ok()) {
    return report.status();
  }
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.dataset},
                              {"steps", report->steps},
                              {"chunks", report->chunks},
                              {"bytes", report->bytes},
                              {"problems", report->problems},
                              {"lost_steps", report->lost_steps}}));
  } else {
    PrintLine(fmt::format("{}: {}, {} chunks, {} checked", command.dataset,
                          CountOf(report->steps, "step"), report->chunks,
                          HumanBytes(report->bytes)));
    for (const std::string& problem : report->problems) {
      PrintLine("  damaged: " + problem);
    }
    for (const auto& [field, steps] : report->lost_steps) {
      PrintLine("  lost: " + DescribeLost(field, steps));
    }
  }
  if (!report->problems.empty()) {
    return DataLoss("{} is damaged in {} places; pictures leave damaged chunks out, with a warning",
                    command.dataset, report->problems.size());
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
