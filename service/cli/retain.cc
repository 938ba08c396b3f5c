#include "engine/store/retain.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/dataset_output.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"

namespace fovea::cli {

CLI::App* AddRetain(CLI::App* app, RetainCommand* command) {
  CLI::App* verb =
      AddVerb(app, "retain", "Cut a dataset down to the detail in some windows",
              "  fovea retain smoke.zarr --retain 19,19,20:32 -o small.zarr\n"
              "  fovea retain smoke.zarr --retain 19,19,20:32 --retain 1.5,2,4w:16 --in-place\n"
              "Whole chunks stay or go, so that nothing is lost inside the windows. Coarse levels, "
              "times and\n"
              "statistics stay as they are. In place: others may read meanwhile; if it is stopped, "
              "the same\n"
              "command goes on.");
  AddDataset(verb, &command->dataset);
  AddRetainFlag(verb, &command->windows);
  verb->get_option("--retain")->required();
  CLI::Option* copy =
      verb->add_option("-o,--output", command->copy, "The new dataset")->type_name("NEW.zarr");
  verb->add_flag("--in-place", command->in_place, "Drop the rest from the dataset itself, for good")
      ->excludes(copy);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(RetainCommand* command) {
  if (command->copy.empty() && !command->in_place) {
    return InvalidArgument("name the new dataset (-o), or say --in-place: detail is then lost");
  }
  return absl::OkStatus();
}

Status Run(const RetainCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(command.dataset));
  if (!command.in_place) {
    PrepareOutput(command.output, command.copy);
  }
  const auto windows = store::InVoxels(command.windows, dataset->info().index_to_world);
  const StatusOr<store::RetainReport> report = [&] {
    Progress progress(command.output, "retain", "steps");
    const auto update = [&](int64_t done, int64_t total) {
      progress.Update(done, total);
      return !Interrupted();
    };
    return command.in_place ? store::RetainInPlace(command.dataset, windows, update)
                            : store::RetainCopy(command.dataset, command.copy, windows, update);
  }();
  if (!report.ok()) {
    return report.status();
  }
  const std::string& made = command.in_place ? command.dataset : command.copy;
  const store::CutCounts& counts = report->counts;
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", made},
                              {"steps", report->steps},
                              {"chunks_kept", counts.chunks_kept},
                              {"chunks_dropped", counts.chunks_dropped},
                              {"bytes_dropped", counts.bytes_dropped}}));
  } else {
    PrintLine(fmt::format("{}: {}, {} chunks of detail kept, {} dropped ({})", made,
                          CountOf(report->steps, "step"), counts.chunks_kept, counts.chunks_dropped,
                          HumanBytes(counts.bytes_dropped)));
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
