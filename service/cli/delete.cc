#include <memory>
#include <optional>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"
#include "service/client/client.h"

namespace fovea::cli {

CLI::App* AddDelete(CLI::App* app, DeleteCommand* command) {
  CLI::App* verb =
      AddVerb(app, "delete", "Remove a dataset from a server, for good",
              "  fovea delete lab/smoke --server 127.0.0.1:50051          # says what would go\n"
              "  fovea delete lab/smoke --server 127.0.0.1:50051 --yes\n"
              "The server must take writes (--allow-ingest, or a token with the right to "
              "write). A dataset\n"
              "on this machine that no server holds is a folder: remove that.");
  verb->add_option("dataset", command->dataset, "Its name, as `fovea info --server` lists it")
      ->required()
      ->type_name("NAME");
  AddServerFlags(verb, &command->server, &command->credentials);
  verb->add_flag("--yes", command->yes, "Remove it, and do not ask");
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(DeleteCommand* command) {
  return command->server ? absl::OkStatus()
                         : InvalidArgument("--server is missing: whose dataset is it?");
}

Status Run(const DeleteCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto client,
                         client::Client::Connect(*command.server, command.credentials));
  if (!command.yes) {
    FOVEA_ASSIGN_OR_RETURN(const client::DatasetSummary there, client->GetDataset(command.dataset));
    const Int3& dims = there.info.hierarchy.dims();
    return FailedPrecondition(
        "'{}' on {} has {} steps of {} x {} x {} voxels, and nothing brings them back; add --yes "
        "to remove it",
        there.name, *command.server, there.info.committed_steps, dims.x, dims.y, dims.z);
  }
  FOVEA_RETURN_IF_ERROR(client->DeleteDataset(command.dataset));
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.dataset}}));
  } else {
    PrintLine(fmt::format("{}: removed from {}", command.dataset, *command.server));
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
