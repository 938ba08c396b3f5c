#include <CLI/CLI.hpp>

#include "ingest/ingest_checks.h"
#include "service/cli/checks.h"
#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/cli/foreign_flags.h"
#include "service/cli/ingest_remote.h"
#include "service/cli/verbs.h"
#include "service/frames/frames.h"

// The verbs that make datasets and look into them.

namespace fovea::cli {

namespace {

/// With --from-plan only the flags of how, not of what, can be given; otherwise only those that
/// apply to the files.
void RefuseWhatCannotApply(CLI::App* verb, const IngestCommand* command) {
  std::vector<const CLI::Option*> said;
  for (const CLI::Option* option : verb->get_options()) {
    const std::string name = option->get_name();
    if (name != "--help" && name != "--output" && name != "--shard" && name != "--from-plan" &&
        !name.starts_with("--worker")) {
      said.push_back(option);
    }
  }
  verb->parse_complete_callback([verb, said, command] {
    for (const CLI::Option* option : said) {
      if (verb->count("--from-plan") > 0 && option->count() > 0) {
        throw CLI::ValidationError(
            "--from-plan", fmt::format("not with {}: the plan says it", option->get_name()));
      }
    }
    RefuseFlagsOfOtherFiles(*verb, command->ingest.inputs);
  });
}

}  // namespace

CLI::App* AddIngest(CLI::App* app, IngestCommand* command) {
  CLI::App* verb = AddVerb(
      app, "ingest",
      "Make a dataset of VDB, NRRD, MetaImage, NIfTI, NumPy files, slices, or raw voxels",
      "  fovea ingest 'smoke_####.vdb' -o smoke.zarr\n"
      "  fovea ingest brain.nii.gz -o brain.zarr\n"
      "  fovea ingest slices/ --spacing 0.5,0.5,2 -o slices.zarr\n"
      "  fovea ingest 'smoke_*.vdb' --grid density --grid temperature -o smoke.zarr\n"
      "  fovea ingest bonsai.raw --raw 256x256x256:uint8 -o bonsai.zarr\n"
      "  fovea ingest 'fmri_%04d.raw' --raw 64x64x21:int16:be --fps 0.5 -o fmri.zarr\n"
      "  fovea ingest 'live/smoke_####.vdb' -o smoke.zarr --watch --extent -64,-64,0,64,64,256\n"
      "  fovea ingest 'smoke_####.vdb' --plan smoke.plan.json    # then, on several machines:\n"
      "  fovea ingest --from-plan smoke.plan.json --shard 0/4 -o smoke.zarr\n"
      "  fovea ingest brain.nii.gz -o lab/brain --server 127.0.0.1:50051    # read here, kept "
      "there\n"
      "What is committed stays, whatever happens later: Ctrl-C loses at most the step in hand, "
      "and\n"
      "the same command goes on at the first missing step.");
  verb->add_option("input", command->ingest.inputs, "Files, globs, or 'smoke_####.vdb'")
      ->type_name("INPUT...");
  verb->add_option("-o,--output", command->ingest.output, "The dataset to make")
      ->type_name("DS.zarr");
  verb->add_option("--field", command->ingest.field,
                   "All but VDB: what the values are called "
                   "(default density)")
      ->type_name("F");
  AddTimeFlags(verb, &command->ingest);
  CLI::Option* append =
      verb->add_flag("--append", command->ingest.append, "Add steps to a dataset that is there");
  verb->add_option("--chunk", command->ingest.chunk_edge,
                   "Edge of a chunk: 8, 16 or 32 "
                   "coefficients (default 16)")
      ->check(CLI::IsMember({8, 16, 32}))
      ->type_name("C")
      ->excludes(append);
  AddExtentFlag(verb, &command->ingest.extent);
  AddRetainFlag(verb, &command->ingest.retain);
  append->excludes("--extent")->excludes("--retain");
  AddBasisFlags(verb, &command->ingest);
  AddForeignFlags(verb, &command->ingest);
  AddPartFlags(verb, command);
  AddWatchFlags(verb, command);
  AddServerFlags(verb, &command->server, &command->credentials);
  RefuseWhatCannotApply(verb, command);
  AddThreadsFlag(verb, &command->ingest.threads);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(IngestCommand* command) {
  if (command->from_plan.empty() && command->ingest.inputs.empty()) {
    return InvalidArgument("input is missing: name the files to ingest, or a plan (--from-plan)");
  }
  if (command->plan.empty() && command->ingest.output.empty()) {
    return InvalidArgument("--output is missing: name the dataset to make (-o)");
  }
  if (command->server) {
    FOVEA_RETURN_IF_ERROR(CheckUpload(*command));
  }
  if (!command->plan.empty() && (command->watch || command->ingest.append)) {
    return InvalidArgument("--plan: a plan is of a whole, new series, without {}",
                           command->watch ? "--watch" : "--append");
  }
  return ingest::CheckCoding(command->ingest);
}

CLI::App* AddInfo(CLI::App* app, InfoCommand* command) {
  CLI::App* verb = AddVerb(app, "info", "What is inside a dataset, or what a server has",
                           "  fovea info smoke.zarr\n"
                           "  fovea info --server 127.0.0.1:50051\n"
                           "  fovea info --server 127.0.0.1:50051 smoke --json\n"
                           "  fovea info --server 127.0.0.1:50051 lab/live --watch");
  verb->add_option("dataset", command->dataset, "The dataset's folder, or its name on the server")
      ->type_name("DS.zarr");
  AddServerFlags(verb, &command->server, &command->credentials);
  verb->add_flag("--watch", command->watch,
                 "With --server: a line for each step, those that are there and then each as it is "
                 "committed, until Ctrl-C");
  AddOutputFlags(verb, &command->output);
  return verb;
}

CLI::App* AddStats(CLI::App* app, StatsCommand* command) {
  CLI::App* verb = AddVerb(app, "stats", "Least and greatest value and histogram of each step",
                           "  fovea stats smoke.zarr\n"
                           "  fovea stats smoke.zarr --field temperature --steps 0-20x5 --json");
  AddDataset(verb, &command->dataset);
  AddFieldFlag(verb, &command->field);
  AddStepsFlag(verb, &command->steps);
  AddOutputFlags(verb, &command->output);
  return verb;
}

CLI::App* AddVerify(CLI::App* app, VerifyCommand* command) {
  CLI::App* verb = AddVerb(app, "verify", "Read everything and check every checksum",
                           "  fovea verify smoke.zarr\n"
                           "Ends with 1 if anything is damaged, and lists it.");
  AddDataset(verb, &command->dataset);
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(InfoCommand* command) {
  if (command->watch && (command->dataset.empty() || !command->server)) {
    return InvalidArgument("--watch: name a dataset of a server (--server HOST:PORT)");
  }
  if (command->dataset.empty() && !command->server) {
    return InvalidArgument("dataset is missing: name a folder, or a server with --server");
  }
  return absl::OkStatus();
}

CLI::App* AddExtract(CLI::App* app, ExtractCommand* command) {
  CLI::App* verb = AddVerb(
      app, "extract", "The voxels of a step back, as .npy or .raw",
      "  fovea extract smoke.zarr --step 3 -o step3.npy\n"
      "  fovea extract smoke.zarr --step 3 --box 0,0,0,16,16,16 -o corner.raw\n"
      "  fovea extract smoke.zarr --step 3 --fovea 19,19,20 --rate 16 -o foveated.npy\n"
      ".npy is float32 of shape (z, y, x); .raw the same bytes without a header, x fastest.");
  AddDataset(verb, &command->dataset);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(Whole(0))
      ->type_name("N");
  AddFieldFlag(verb, &command->field);
  const auto on_box = [command](const std::string& text) {
    StatusOr<Box3> box = ParseBox(text);
    if (!box.ok()) {
      throw CLI::ValidationError("--box", std::string(MessageOf(box.status())));
    }
    command->box = *box;
  };
  verb->add_option_function<std::string>("--box", on_box,
                                         "Only these voxels; X1,Y1,Z1 are not included")
      ->type_name("X0,Y0,Z0,X1,Y1,Z1");
  AddFoveaFlags(verb, &command->fovea, &command->rate, &command->window);
  verb->add_flag("--strict", command->strict,
                 "A damaged chunk is an error; else coarser values stand there, with a warning");
  verb->add_option("-o,--output", command->file, "The file to write: .npy or .raw")
      ->required()
      ->type_name("FILE");
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(ExtractCommand* command) {
  if (!command->file.ends_with(".npy") && !command->file.ends_with(".raw")) {
    return InvalidArgument("--output: '{}' must end in .npy or .raw", command->file);
  }
  frames::FrameSpec spec;
  spec.fovea = command->fovea;
  spec.rate = command->rate;
  spec.window = command->window;
  return frames::ValidateSpec(spec);
}

}  // namespace fovea::cli
