#include <map>

#include <CLI/CLI.hpp>

#include "service/cli/checks.h"
#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"
#include "service/frames/frames.h"

// The command line of `fovea jobs`.

namespace fovea::cli {
namespace {

/// One of a few words.
template <typename T>
void AddChoice(CLI::App* app, const char* flag, const std::map<std::string, T>& words, T* target,
               const char* help) {
  std::string names;
  for (const auto& [word, value] : words) {
    names += (names.empty() ? "" : ", ") + word;
  }
  const auto on_text = [=](const std::string& text) {
    const auto found = words.find(text);
    if (found == words.end()) {
      throw CLI::ValidationError(flag, fmt::format("'{}' is none of {}", text, names));
    }
    *target = found->second;
  };
  app->add_option_function<std::string>(flag, on_text, help)->type_name("WHAT");
}

void AddCommonFlags(CLI::App* app, JobsCommand* command) {
  app->add_flag("--watch", command->watch,
                "Follow the job to its end: a line of progress (with --json: a value each time "
                "that it changes), and its exit status. Ctrl-C ends this, not the job");
  AddServerFlags(app, &command->server, &command->credentials);
  app->get_option("--server")->description("The server that does the work");
  AddOutputFlags(app, &command->output);
}

void AddJobsIngest(CLI::App* jobs, JobsCommand* command) {
  client::IngestRequest& request = command->ingest;
  CLI::App* app = AddVerb(
      jobs, "ingest", "Begin a job: files that the server reaches to a dataset of it",
      "  fovea jobs ingest 'smoke_####.vdb' --dataset smoke --server 127.0.0.1:50051\n"
      "  fovea jobs ingest lab/bonsai.raw --raw 256x256x256:uint8 --dataset lab/bonsai \\\n"
      "    --server 127.0.0.1:50051 --watch\n"
      "Files are named from the server's ingest root (`fovea serve --ingest-root DIR`). The same\n"
      "command again, after a failure or a cancel, goes on at the first step that is missing.");
  app->callback([command] { command->what = JobsCommand::What::kIngest; });
  app->add_option("files", request.files,
                  "Files, globs, or 'smoke_####.vdb', below the server's ingest root")
      ->required()
      ->type_name("FILE...");
  app->add_option("--dataset", request.dataset,
                  "The dataset to make or go on with, as the server names it: no .zarr")
      ->required()
      ->type_name("NAME");
  app->add_option("--raw", request.raw,
                  "Files are headerless voxels: NXxNYxNZ[xSTEPS]:TYPE[:le|be], such as "
                  "256x256x225:uint8")
      ->type_name("FORMAT");
  app->add_option("--grid", request.grids,
                  "VDB: a grid to take; may be given more than once (default: every scalar grid)")
      ->allow_extra_args(false)
      ->type_name("NAME");
  app->add_option("--field", request.field,
                  "All but VDB: what the values are called (default density)")
      ->type_name("F");
  app->add_option("--fps", request.frames_per_second,
                  "Frames a second: the time of a step is its number / this (default: as the files "
                  "say, else 24)")
      ->check(Within(1e-6, 1e6))
      ->type_name("R");
  using Request = client::IngestRequest;
  AddChoice<Request::OnMissing>(app, "--on-missing",
                                {{"error", Request::OnMissing::kError},
                                 {"skip", Request::OnMissing::kSkip},
                                 {"hold", Request::OnMissing::kHold}},
                                &request.on_missing,
                                "A missing file or grid is an error, skip or hold: stop, leave it "
                                "out, or show the step before (default error)");
  AddChoice<Request::Registration>(
      app, "--registration",
      {{"index", Request::Registration::kIndex}, {"world", Request::Registration::kWorld}},
      &request.registration,
      "VDB grids or steps whose transforms differ: index (voxel i "
      "stays voxel i) or world (moved to where the first lie); "
      "without it they are an error");
  app->add_option("--wavelet", request.wavelet, "haar, cdf53 or cdf97 (default haar)")
      ->check(CLI::IsMember({"haar", "cdf53", "cdf97"}))
      ->type_name("W");
  app->add_flag("--lossless", request.lossless,
                "Reversible integer coefficients, haar or cdf53: for voxels of 8 or 16 bits");
  app->add_option("--tolerance", request.tolerance,
                  "Quantised coefficients: no voxel is farther off, in data units")
      ->check(Positive())
      ->type_name("E");
  AddCommonFlags(app, command);
}

void AddJobsExport(CLI::App* jobs, JobsCommand* command) {
  client::ExportRequest& request = command->shot;
  CLI::App* app = AddVerb(
      jobs, "export", "Begin a job: a dataset of the server to pictures or a movie there",
      "  fovea jobs export smoke -o 'smoke/f.####.png' --server 127.0.0.1:50051\n"
      "  fovea jobs export smoke -o shot.mp4 --animation shot.json --size 1280x720 \\\n"
      "    --server 127.0.0.1:50051 --watch\n"
      "  fovea jobs export smoke -o turn.mp4 --orbit 360 --server 127.0.0.1:50051 --watch\n"
      "Files appear below the server's export root (`fovea serve --export-root DIR`). What is "
      "left\n"
      "out is chosen by the dataset, now. The same command again keeps the pictures that are "
      "there.\n"
      "docs/export.md describes animations.");
  app->callback([command] { command->what = JobsCommand::What::kExport; });
  app->add_option("dataset", request.dataset, "The dataset, as the server names it")
      ->required()
      ->type_name("NAME");
  app->add_option("-o,--output", request.output,
                  "'shot/f.####.png' (.jpg .exr .tif .npy .fvf), or a movie: .mp4 .mov .webm; "
                  "below the server's export root")
      ->required()
      ->type_name("FILE");
  AddStepsFlag(app, &command->steps);
  app->add_option("--animation", command->animation_file,
                  "Keyframes of view, fovea, rate, step: a file on this machine")
      ->type_name("FILE.json");
  AddOrbitFlags(app, &command->orbit_deg, &command->orbit_frames);
  app->add_option("--fps", request.frames_per_second,
                  "Of a movie (default: from the times of the steps, or 24)")
      ->check(Within(0.01, 1000))
      ->type_name("R");
  app->add_flag("--overwrite", request.overwrite, "Make everything again");
  AddPictureFlags(app, &request.spec);
  AddCommonFlags(app, command);
}

}  // namespace

CLI::App* AddJobs(CLI::App* app, JobsCommand* command) {
  CLI::App* verb = AddVerb(
      app, "jobs", "Long work of a server: begin it, see how it stands, end it",
      "  fovea jobs --server 127.0.0.1:50051                     # all of mine, newest first\n"
      "  fovea jobs ingest 'smoke_####.vdb' --dataset smoke --server 127.0.0.1:50051\n"
      "  fovea jobs export smoke -o 'f.####.png' --server 127.0.0.1:50051 --watch\n"
      "  fovea jobs job-0123 --watch --server 127.0.0.1:50051    # to its end\n"
      "  fovea jobs --cancel job-0123 --server 127.0.0.1:50051   # what is finished stays\n"
      "A job goes on when this program ends, and after a restart of the server, which keeps jobs\n"
      "only with `fovea serve --state DIR`. A job belongs to the token it was begun with. With\n"
      "--watch the exit status is the job's: 0 if all was made (or, with --cancel, it is "
      "cancelled),\n"
      "else 1.");
  verb->add_option("id", command->id, "One job (default: all of mine, newest first)")
      ->type_name("ID");
  verb->add_flag("--cancel", command->cancel, "End this job; it is cancelled within a second");
  verb->add_option("--newest", command->newest, "Of all jobs, only so many (default: all)")
      ->check(Whole(1))
      ->type_name("N");
  AddCommonFlags(verb, command);
  AddJobsIngest(verb, command);
  AddJobsExport(verb, command);
  return verb;
}

Status Check(JobsCommand* command) {
  if (!command->server) {
    return InvalidArgument("--server is missing: jobs are a server's, name it (HOST:PORT)");
  }
  if (command->what != JobsCommand::What::kShow) {
    if (!command->id.empty() || command->cancel) {
      return InvalidArgument("id, --cancel: a job that is begun here has no id yet");
    }
    return frames::ValidateSpec(command->shot.spec);
  }
  if (command->id.empty() && (command->watch || command->cancel)) {
    return InvalidArgument("id is missing: name the job to {} (`fovea jobs` lists them)",
                           command->cancel ? "cancel" : "watch");
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
