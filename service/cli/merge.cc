#include "engine/store/merge.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/dataset_output.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"

namespace fovea::cli {

CLI::App* AddMerge(CLI::App* app, MergeCommand* command) {
  CLI::App* verb = AddVerb(
      app, "merge", "Join the parts of a dataset that several machines made",
      "  fovea ingest 'smoke_####.vdb' --plan smoke.plan.json\n"
      "  fovea ingest --from-plan smoke.plan.json --shard 0/2 -o smoke.zarr    # and 1/2 "
      "elsewhere\n"
      "  fovea merge smoke.zarr --remove-parts\n"
      "Joins smoke.part-i-of-n.zarr, all beside smoke.zarr, or the parts that are named. Files "
      "are\n"
      "linked where the file system can, else copied. May be stopped and given again at any time.");
  AddDataset(verb, &command->merge.path);
  verb->add_option("parts", command->merge.parts,
                   "The parts (default: those beside the dataset that are named so)")
      ->type_name("PART.zarr...");
  verb->add_flag("--remove-parts", command->merge.remove_parts,
                 "Remove the parts once the dataset is complete");
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Run(const MergeCommand& command) {
  PrepareOutput(command.output, command.merge.path);
  const StatusOr<store::MergeReport> report = [&] {
    Progress progress(command.output, "merge", "steps");
    return store::Merge(command.merge, [&](int64_t done, int64_t total) {
      progress.Update(done, total);
      return !Interrupted();
    });
  }();
  if (!report.ok()) {
    return report.status();
  }
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.merge.path},
                              {"steps", report->steps},
                              {"parts", report->parts},
                              {"was_merged", report->was_merged},
                              {"parts_removed", report->parts_removed}}));
    return absl::OkStatus();
  }
  PrintLine(
      report->was_merged
          ? fmt::format("{}: {}, merged before", command.merge.path, CountOf(report->steps, "step"))
          : fmt::format("{}: {} of {}", command.merge.path, CountOf(report->steps, "step"),
                        CountOf(report->parts, "part")));
  if (report->parts_removed > 0) {
    PrintLine(CountOf(report->parts_removed, "part") + " removed");
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
