#include <cmath>

#include <CLI/CLI.hpp>

#include "service/cli/checks.h"
#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"
#include "service/export/exporter.h"
#include "service/export/picture_file.h"
#include "service/frames/frames.h"

// The verbs that make pictures.

namespace fovea::cli {
namespace {

/// What is wrong with a command that the flags one by one cannot tell.
Status CheckInput(const PictureInput& input) {
  if (input.server && input.inputs.size() != 1) {
    return InvalidArgument("--server: name one dataset of the server, not {}", input.inputs.size());
  }
  return absl::OkStatus();
}

}  // namespace

CLI::App* AddPlan(CLI::App* app, PlanCommand* command) {
  // Sizes are unsigned: "-5" would wrap around. Of transforms the last added comes first.
  const CLI::Validator not_negative(
      [](std::string& text) {
        return text.find('-') == std::string::npos ? "" : text + " is below 0";
      },
      "");
  CLI::App* verb = AddVerb(
      app, "plan", "What a picture will cost, or the largest rate that a budget allows",
      "  fovea plan smoke.zarr --step 3 --fovea 19,19,20 --rate 40 --size 1024x1024\n"
      "  fovea plan smoke.zarr --budget-ms 16 --json\n"
      "  fovea plan smoke.zarr --budget-memory 64MiB --budget-bytes 2MiB\n"
      "  fovea plan --server 127.0.0.1:50051 smoke --budget-ms 16\n"
      "From metadata alone. Coefficients, samples, chunks and bytes are exact, memory is an upper\n"
      "bound, milliseconds are a prediction. Of several budgets the tightest counts.");
  AddDataset(verb, &command->dataset);
  AddServerFlags(verb, &command->server, &command->credentials);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(Whole(0))
      ->type_name("N");
  verb->add_option("--budget-ms", command->budget.ms, "Milliseconds, without encoding")
      ->check(Positive())
      ->type_name("MS");
  verb->add_option("--budget-memory", command->budget.memory_bytes, "Memory, such as 64MiB")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->transform(not_negative)
      ->type_name("BYTES");
  verb->add_option("--budget-bytes", command->budget.bytes_read,
                   "Read from the store, such as 2MiB")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->transform(not_negative)
      ->type_name("BYTES");
  verb->add_option("--budget-coefficients", command->budget.coefficients, "m, such as 500000")
      ->check(Whole(1))
      ->type_name("M");
  AddPictureFlags(verb, &command->spec);
  AddThreadsFlag(verb, &command->threads);
  verb->get_option("--threads")->excludes("--server");
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(PlanCommand* command) {
  if (command->spec.rate && !command->budget.IsEmpty()) {
    return InvalidArgument("rate {} and a budget: give one of them; a budget chooses the rate",
                           FormatRate(*command->spec.rate));
  }
  if (command->budget.ms && !std::isfinite(*command->budget.ms)) {
    return InvalidArgument("--budget-ms must be a finite number of milliseconds");
  }
  return frames::ValidateSpec(command->spec);
}

CLI::App* AddRender(CLI::App* app, RenderCommand* command) {
  CLI::App* verb = AddVerb(
      app, "render", "One picture of one step",
      "  fovea render smoke.zarr -o smoke.png\n"
      "  fovea render smoke.zarr --step 30 --fovea 19,19,20 --rate 40 --view 30,20 -o f.exr\n"
      "  fovea render smoke.vdb -o smoke.jpg\n"
      "  fovea render bonsai.raw --raw 256x256x256:uint8 --size 1024x1024 -o bonsai.png\n"
      "  fovea render --server 127.0.0.1:50051 smoke --step 30 -o f.png\n"
      "  fovea render --server 127.0.0.1:50051 smoke --step 30 --local -o f.exr\n"
      "  fovea render --server 127.0.0.1:50051 smoke --refine -o f.png    # soon, then sharper\n"
      "The name chooses the format: .png .jpg are sRGB over the background; .fvf is the FOVEATED\n"
      "frame that `fovea expand` makes these of; .exr .tif .npy are\n"
      "linear, premultiplied RGBA. What was not said is chosen, and printed as flags.");
  AddPictureInput(verb, &command->input);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(Whole(0))
      ->type_name("N");
  verb->add_option("-o,--output", command->file, "The picture: .png .jpg .exr .tif .npy .fvf")
      ->required()
      ->type_name("FILE");
  verb->add_flag("--refine", command->refine,
                 "With --server: write the picture coarse at once, and again each time that it is "
                 "sharper; a line for each (with --json: a value each)")
      ->needs("--server")
      ->excludes("--local")
      ->excludes("--foveated");
  AddPictureFlags(verb, &command->spec);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(RenderCommand* command) {
  FOVEA_RETURN_IF_ERROR(CheckInput(command->input));
  const auto format = exports::PictureFormatOf(command->file);
  FOVEA_RETURN_IF_ERROR(Annotate(format.status(), "--output"));
  command->spec.encoding = exports::EncodingFor(*format);
  if (command->spec.fovea_marker && command->spec.encoding == frames::Encoding::kRawRgbaF32) {
    return InvalidArgument(
        "fovea_marker: the red dot is drawn in .png and .jpg only, not in "
        "linear pictures such as '{}'",
        command->file);
  }
  return frames::ValidateSpec(command->spec);
}

CLI::App* AddExport(CLI::App* app, ExportCommand* command) {
  CLI::App* verb = AddVerb(
      app, "export", "A sequence of pictures, or a movie",
      "  fovea export 'smoke.####.vdb' -o smoke.mp4\n"
      "  fovea export smoke.zarr --steps 0-120x2 -o 'out/f.####.exr'\n"
      "  fovea export smoke.zarr --orbit 360 --orbit-frames 96 --size 1280x720 -o turn.mp4\n"
      "  fovea export smoke.zarr --animation shot.json -o 'shot.####.png' --shard 0/4\n"
      "  fovea export --server 127.0.0.1:50051 smoke -o 'f.####.png'\n"
      "#### is the source's frame number where there is one, else the step. Started again, it\n"
      "goes on after the frames that are done. docs/export.md describes shot.json.");
  AddPictureInput(verb, &command->input);
  AddStepsFlag(verb, &command->steps);
  verb->add_option("-o,--output", command->file,
                   "'f.####.png' (.jpg .exr .tif .npy .fvf), or a movie: .mp4 .mov .webm")
      ->required()
      ->type_name("FILE");
  verb->add_option("--animation", command->animation_file, "Keyframes of view, fovea, rate, step")
      ->type_name("FILE.json");
  AddOrbitFlags(verb, &command->orbit_deg, &command->orbit_frames);
  verb->add_option("--fps", command->frames_per_second,
                   "Of a movie (default: from the times of the steps, or 24)")
      ->type_name("R");
  const auto on_shard = [command](const std::string& text) {
    StatusOr<Shard> shard = ParseShard(text);
    if (!shard.ok()) {
      throw CLI::ValidationError("--shard", std::string(MessageOf(shard.status())));
    }
    command->shard = *shard;
  };
  verb->add_option_function<std::string>(
          "--shard", on_shard, "Only part i of n, for arrays of jobs: frames i, i + n ...")
      ->type_name("i/n");
  verb->add_flag("--overwrite", command->overwrite, "Make everything again");
  AddPictureFlags(verb, &command->spec);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(ExportCommand* command) {
  FOVEA_RETURN_IF_ERROR(CheckInput(command->input));
  exports::ExportOptions options;
  options.output = command->file;
  options.spec = command->spec;
  options.frames_per_second = command->frames_per_second;
  options.shard_index = command->shard.index;
  options.shard_count = command->shard.count;
  FOVEA_RETURN_IF_ERROR(exports::ValidateExport(options));
  return frames::ValidateSpec(command->spec);
}

CLI::App* AddBench(CLI::App* app, BenchCommand* command) {
  CLI::App* verb = AddVerb(
      app, "bench", "What a frame of your data costs, phase by phase, beside full resolution",
      "  fovea bench smoke.zarr\n"
      "  fovea bench smoke.zarr --step 30 --rate 25 --size 1024x1024 --rounds 9 --json\n"
      "Measures on one thread and on --threads, in turns; medians of the rounds. The store is\n"
      "in the page cache, and is read on all threads. A volume too large for full resolution is "
      "measured without it.");
  AddDataset(verb, &command->dataset);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(Whole(0))
      ->type_name("N");
  verb->add_option("--rounds", command->rounds, "How often, 1 to 1000 (default 5)")
      ->check(Whole(1, 1000))
      ->type_name("R");
  AddPictureFlags(verb, &command->spec);
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(BenchCommand* command) {
  if (command->spec.color_field) {
    return InvalidArgument("color_field: a benchmark measures one field; leave it out");
  }
  if (command->spec.mode) {
    return InvalidArgument("mode: a benchmark measures both; leave it out");
  }
  return frames::ValidateSpec(command->spec);
}

CLI::App* AddServe(CLI::App* app, ServeCommand*) {
  CLI::App* verb =
      app->add_subcommand("serve", "The gRPC service over all datasets below a folder");
  verb->set_help_flag();
  verb->prefix_command();
  return verb;
}

CLI::App* AddDemo(CLI::App* app, DemoCommand* command) {
  CLI::App* verb =
      AddVerb(app, "demo", "No data at hand: makes a small moving volume and shows it",
              "  fovea demo --out demo\n"
              "Makes a plume of 24 steps, renders it with several foveas and rates, and\n"
              "(where ffmpeg is) as a movie.");
  verb->add_option("--out", command->folder,
                   "Where everything goes (default: a new folder in the "
                   "temporary one)")
      ->type_name("DIR");
  verb->add_option("--edge", command->edge_voxels, "Voxels a side, 16 to 512 (default 96)")
      ->check(Whole(16, 512))
      ->type_name("N");
  verb->add_option("--steps", command->steps, "Steps, 1 to 1000 (default 24)")
      ->check(Whole(1, 1000))
      ->type_name("N");
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
  return verb;
}

}  // namespace fovea::cli
