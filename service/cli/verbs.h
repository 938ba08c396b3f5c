#ifndef SERVICE_CLI_VERBS_H_
#define SERVICE_CLI_VERBS_H_

#include <string>

#include "service/cli/commands.h"

namespace CLI {
class App;
}

/// The command line of each verb: its flags, which fill `command` (it must outlive parsing), and
/// what is wrong with a command that the flags one by one cannot tell. parse.cc lists the verbs.
namespace fovea::cli {

CLI::App* AddIngest(CLI::App* app, IngestCommand* command);
CLI::App* AddSensors(CLI::App* app, SensorsCommand* command);
CLI::App* AddInfo(CLI::App* app, InfoCommand* command);
CLI::App* AddStats(CLI::App* app, StatsCommand* command);
CLI::App* AddVerify(CLI::App* app, VerifyCommand* command);
CLI::App* AddRepair(CLI::App* app, RepairCommand* command);
CLI::App* AddMerge(CLI::App* app, MergeCommand* command);
CLI::App* AddRetain(CLI::App* app, RetainCommand* command);
CLI::App* AddExtract(CLI::App* app, ExtractCommand* command);
CLI::App* AddPlan(CLI::App* app, PlanCommand* command);
CLI::App* AddRender(CLI::App* app, RenderCommand* command);
CLI::App* AddExpand(CLI::App* app, ExpandCommand* command);
CLI::App* AddExport(CLI::App* app, ExportCommand* command);
CLI::App* AddBench(CLI::App* app, BenchCommand* command);
CLI::App* AddServe(CLI::App* app, ServeCommand* command);
CLI::App* AddJobs(CLI::App* app, JobsCommand* command);
CLI::App* AddToken(CLI::App* app, TokenCommand* command);
CLI::App* AddDelete(CLI::App* app, DeleteCommand* command);
CLI::App* AddDoctor(CLI::App* app, DoctorCommand* command);
CLI::App* AddDemo(CLI::App* app, DemoCommand* command);

/// May also fill in what follows from the rest. A verb without one has nothing to check.
[[nodiscard]] Status Check(SensorsCommand* command);
[[nodiscard]] Status Check(IngestCommand* command);
[[nodiscard]] Status Check(InfoCommand* command);
[[nodiscard]] Status Check(RepairCommand* command);
[[nodiscard]] Status Check(RetainCommand* command);
[[nodiscard]] Status Check(ExtractCommand* command);
[[nodiscard]] Status Check(PlanCommand* command);
[[nodiscard]] Status Check(RenderCommand* command);
[[nodiscard]] Status Check(ExpandCommand* command);
[[nodiscard]] Status Check(ExportCommand* command);
[[nodiscard]] Status Check(BenchCommand* command);
[[nodiscard]] Status Check(JobsCommand* command);
[[nodiscard]] Status Check(TokenCommand* command);
[[nodiscard]] Status Check(DeleteCommand* command);
template <typename T>
[[nodiscard]] Status Check(T*) {
  return absl::OkStatus();
}

/// A verb with its examples, and the positional DS.zarr.
CLI::App* AddVerb(CLI::App* app, const char* name, const char* help, const char* examples);
void AddDataset(CLI::App* verb, std::string* dataset);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_VERBS_H_
