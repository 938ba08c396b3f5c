#include "engine/store/repair.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/dataset_output.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"

namespace fovea::cli {
namespace {

void Print(const RepairCommand& command, const store::RepairReport& report) {
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.dataset},
                              {"output", command.in_place ? command.dataset : command.file},
                              {"steps", report.steps},
                              {"chunks_kept", report.chunks_kept},
                              {"lost", report.lost},
                              {"rebuilt", report.rebuilt}}));
    return;
  }
  PrintLine(fmt::format("{}: {}, {} chunks of detail kept", command.dataset,
                        CountOf(report.steps, "step"), report.chunks_kept));
  for (const std::string& line : report.rebuilt) {
    PrintLine("  rebuilt: " + line);
  }
  for (const std::string& line : report.lost) {
    PrintLine("  lost: " + line);
  }
}

}  // namespace

CLI::App* AddRepair(CLI::App* app, RepairCommand* command) {
  CLI::App* verb =
      AddVerb(app, "repair", "Save what is sound of a damaged dataset, and say what was lost",
              "  fovea repair smoke.zarr -o mended.zarr\n"
              "  fovea repair smoke.zarr --in-place\n"
              "Ends with 0 if nothing was lost, with 1 if something was, or if it failed.");
  AddDataset(verb, &command->dataset);
  CLI::Option* file =
      verb->add_option("-o,--output", command->file, "The new dataset; it must not be there yet")
          ->type_name("NEW.zarr");
  verb->add_flag("--in-place", command->in_place, "Change the dataset itself")->excludes(file);
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(RepairCommand* command) {
  if (command->file.empty() && !command->in_place) {
    return InvalidArgument("where to? Name a new dataset with -o, or say --in-place");
  }
  return absl::OkStatus();
}

Status Run(const RepairCommand& command) {
  if (!command.in_place) {
    PrepareOutput(command.output, command.file);
  }
  const StatusOr<store::RepairReport> report = [&] {
    Progress progress(command.output, "repair", "steps");
    return store::Repair(
        command.dataset, {command.file, command.threads},
        [&](const store::RepairReport& found) {
          // What was lost is said before anything is changed.
          Print(command, found);
          return !Interrupted();
        },
        [&](int64_t done, int64_t total) {
          progress.Update(done, total);
          return !Interrupted();
        });
  }();
  FOVEA_RETURN_IF_ERROR(report.status());
  if (!report->lost.empty()) {
    return DataLoss("{}: {} things were lost; what is left is sound", command.dataset,
                    report->lost.size());
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
