#include <fstream>

#include <fmt/chrono.h>
#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/orbit.h"
#include "service/export/frame_provider.h"

namespace fovea::cli {
namespace {

using client::Job;
using client::JobKind;
using client::JobState;
using nlohmann::json;

constexpr size_t kMaxAnimationBytes = size_t{512} << 10;  // as much as a server takes

/// As the proto writes it.
const char* NameOf(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return "QUEUED";
    case JobState::kRunning:
      return "RUNNING";
    case JobState::kDone:
      return "DONE";
    case JobState::kFailed:
      return "FAILED";
    case JobState::kCancelled:
      return "CANCELLED";
  }
  return "";
}

const char* WordOf(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return "queued";
    case JobState::kRunning:
      return "running";
    case JobState::kDone:
      return "done";
    case JobState::kFailed:
      return "failed";
    case JobState::kCancelled:
      return "cancelled";
  }
  return "";
}

const char* UnitOf(const Job& job) {
  return job.kind == JobKind::kExport ? "frames" : "steps";
}

json ToJson(const Job& job) {
  json value = {{"id", job.id},
                {"kind", job.kind == JobKind::kExport ? "EXPORT" : "INGEST_FILES"},
                {"state", NameOf(job.state)},
                {"dataset", job.dataset},
                {"target", job.target},
                {"done", job.done},
                {"total", job.total},
                {"failed", job.failed},
                {"now", job.now},
                {"message", job.message},
                {"failures", json::array()},
                {"warnings", job.warnings},
                {"warning_count", job.warning_count},
                {"created_ms", job.created_ms}};
  for (const Job::Failure& failure : job.failures) {
    value["failures"].push_back({{"file", failure.file}, {"reason", failure.reason}});
  }
  if (job.seconds_left) {
    value["seconds_left"] = *job.seconds_left;
  }
  if (job.started_ms) {
    value["started_ms"] = *job.started_ms;
  }
  if (job.ended_ms) {
    value["ended_ms"] = *job.ended_ms;
  }
  return value;
}

/// "12 of 24 steps, 1 failed, 30 s left".
std::string ProgressOf(const Job& job) {
  std::string text = job.total > 0 ? fmt::format("{} of {} {}", job.done, job.total, UnitOf(job))
                                   : fmt::format("{} {}", job.done, UnitOf(job));
  if (job.failed > 0) {
    text += fmt::format(", {} failed", job.failed);
  }
  if (job.warning_count > 0) {
    text += fmt::format(", {} warning{}", job.warning_count, job.warning_count == 1 ? "" : "s");
  }
  if (job.seconds_left) {
    text += fmt::format(", {} left", HumanSeconds(*job.seconds_left));
  }
  return text;
}

/// "export of smoke to f.####.png".
std::string WorkOf(const Job& job) {
  return job.kind == JobKind::kExport ? fmt::format("export of {} to {}", job.dataset, job.target)
                                      : fmt::format("ingest to {}", job.dataset);
}

std::string TimeOf(int64_t ms) {
  // What a broken server says may be no time that a calendar has.
  constexpr int64_t kYear9999Ms = 253'402'300'799'000;
  return ms < 0 || ms > kYear9999Ms
             ? fmt::format("{} ms", ms)
             : fmt::format("{:%Y-%m-%d %H:%M:%S} UTC", fmt::gmtime(std::time_t{ms / 1000}));
}

void PrintOne(const Job& job) {
  PrintLine(fmt::format("{}: {}", job.id, WorkOf(job)));
  PrintLine(fmt::format("  state     {}, {}", WordOf(job.state), ProgressOf(job)));
  if (!job.now.empty()) {
    PrintLine("  now       " + job.now);
  }
  PrintLine("  created   " + TimeOf(job.created_ms));
  if (job.started_ms) {
    PrintLine("  started   " + TimeOf(*job.started_ms));
  }
  if (job.ended_ms) {
    PrintLine("  ended     " + TimeOf(*job.ended_ms));
  }
  if (!job.message.empty()) {
    PrintLine("  why       " + job.message);
  }
  for (const Job::Failure& failure : job.failures) {
    PrintLine(fmt::format("  failed    {}: {}", failure.file, failure.reason));
  }
  for (const std::string& warning : job.warnings) {
    PrintLine("  warning   " + warning);
  }
}

void Print(const JobsCommand& command, const Job& job) {
  command.output.json ? PrintJson(ToJson(job)) : PrintOne(job);
}

Status PrintAll(const JobsCommand& command, client::JobsClient& server) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<Job> jobs, server.List(command.newest));
  if (command.output.json) {
    json list = json::array();
    for (const Job& job : jobs) {
      list.push_back(ToJson(job));
      list.back().erase("failures");  // a list does not have them
      list.back().erase("warnings");
    }
    PrintJson({{"jobs", list}});
    return absl::OkStatus();
  }
  for (const Job& job : jobs) {
    PrintLine(fmt::format("{}  {:9}  {}  {}, {}", job.id, WordOf(job.state), TimeOf(job.created_ms),
                          WorkOf(job), ProgressOf(job)));
  }
  if (jobs.empty()) {
    Note(command.output, "the server has no jobs of yours");
  }
  return absl::OkStatus();
}

/// What the end of a job means for the exit status.
Status Outcome(const JobsCommand& command, const Job& job) {
  switch (job.state) {
    case JobState::kDone:
      return job.failed == 0 ? absl::OkStatus()
                             : FailedPrecondition("{}: {} of {} {} could not be made", job.id,
                                                  job.failed, job.total, UnitOf(job));
    case JobState::kFailed:
      return FailedPrecondition("{} failed: {}", job.id, job.message);
    case JobState::kCancelled:
      return command.cancel ? absl::OkStatus() : Cancelled("{} was cancelled", job.id);
    default:
      return Cancelled("stopped watching; {} goes on: `fovea jobs {} --watch --server {}`", job.id,
                       job.id, *command.server);
  }
}

Status Watch(const JobsCommand& command, client::JobsClient& server, const std::string& id) {
  const StatusOr<Job> last = [&] {
    Progress progress(command.output, "", "");
    const auto on_job = [&](const Job& job) {
      if (command.output.json) {
        PrintJson(ToJson(job));
        std::fflush(stdout);
      } else if (!job.ended()) {
        progress.Show(job.done, false,
                      fmt::format("{}: {}{}{}", WordOf(job.state), ProgressOf(job),
                                  job.now.empty() ? "" : "  ", job.now));
      }
      return !Interrupted();
    };
    return server.Watch(id, on_job, [] { return !Interrupted(); });
  }();
  FOVEA_RETURN_IF_ERROR(last.status());
  if (!command.output.json) {
    PrintOne(*last);
  }
  return Outcome(command, *last);
}

Status ReadAnimation(const std::string& path, std::string* text) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("--animation: cannot open {}", path);
  }
  text->resize(kMaxAnimationBytes + 1);
  file.read(text->data(), static_cast<std::streamsize>(text->size()));
  text->resize(static_cast<size_t>(file.gcount()));
  return text->size() > kMaxAnimationBytes
             ? InvalidArgument("--animation: {} has more than 512 KiB", path)
             : absl::OkStatus();
}

/// The server says from where it turns.
Status AskOrbit(const JobsCommand& command, std::string* text) {
  FOVEA_ASSIGN_OR_RETURN(const auto provider,
                         exports::OpenRemote(*command.server, command.credentials,
                                             command.shot.dataset, exports::Transport::kPictures));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved, provider->Resolve(command.shot.spec));
  const store::DatasetInfo& info = provider->info();
  *text = OrbitJson(MakeOrbit({*command.orbit_deg, command.orbit_frames}, resolved,
                              info.index_to_world, command.steps, info.committed_steps));
  return text->size() > kMaxAnimationBytes
             ? InvalidArgument(
                   "--orbit-frames: a camera that turns in so many frames is described "
                   "in more than 512 KiB; ask for fewer")
             : absl::OkStatus();
}

StatusOr<Job> BeginExport(const JobsCommand& command, client::JobsClient& server) {
  client::ExportRequest request = command.shot;
  request.first = command.steps.first;
  request.last = command.steps.last;
  request.stride = command.steps.stride;
  if (command.animation_file) {
    FOVEA_RETURN_IF_ERROR(ReadAnimation(*command.animation_file, &request.animation_json));
  }
  if (command.orbit_deg) {
    FOVEA_RETURN_IF_ERROR(AskOrbit(command, &request.animation_json));
  }
  return server.Export(request);
}

/// The one job that the command is about, begun or cancelled if it says so.
StatusOr<Job> Ask(const JobsCommand& command, client::JobsClient& server) {
  switch (command.what) {
    case JobsCommand::What::kIngest:
      return server.IngestFiles(command.ingest);
    case JobsCommand::What::kExport:
      return BeginExport(command, server);
    default:
      return command.cancel ? server.Cancel(command.id) : server.Get(command.id);
  }
}

}  // namespace

Status Run(const JobsCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto server,
                         client::JobsClient::Connect(*command.server, command.credentials));
  const bool show = command.what == JobsCommand::What::kShow;
  if (show && command.id.empty()) {
    return PrintAll(command, *server);
  }
  FOVEA_ASSIGN_OR_RETURN(const Job job, Ask(command, *server));
  if (!show && !command.output.json) {
    PrintLine(fmt::format("{}: {}, {}", job.id, WorkOf(job), WordOf(job.state)));
    std::fflush(stdout);
  }
  if (command.watch) {
    return Watch(command, *server, job.id);
  }
  if (show || command.output.json) {
    Print(command, job);
  }
  if (!show) {
    Note(command.output,
         fmt::format("`fovea jobs {} --watch --server {}` follows it", job.id, *command.server));
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
