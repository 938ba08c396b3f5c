#include <array>
#include <cmath>
#include <utility>

#include <CLI/CLI.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/export/exporter.h"
#include "service/export/picture_file.h"
#include "service/frames/frames.h"

namespace fovea::cli {
namespace {

/// Every verb's command, filled while the line is read; the verb that was given is returned.
struct Commands {
  IngestCommand ingest;
  InfoCommand info;
  StatsCommand stats;
  VerifyCommand verify;
  ExtractCommand extract;
  PlanCommand plan;
  RenderCommand render;
  ExportCommand exporting;
  BenchCommand bench;
  ServeCommand serve;
  DemoCommand demo;
};

CLI::App* AddVerb(CLI::App* app, const char* name, const char* help, const char* examples) {
  CLI::App* verb = app->add_subcommand(name, help);
  verb->footer(std::string("Examples:\n") + examples);
  return verb;
}

void AddDataset(CLI::App* verb, std::string* dataset) {
  verb->add_option("dataset", *dataset, "The dataset's folder, NAME.zarr")
      ->required()
      ->type_name("DS.zarr");
}

void AddIngest(CLI::App* app, IngestCommand* command) {
  CLI::App* verb = AddVerb(
      app, "ingest", "Make a dataset of VDB files and sequences, or of raw voxels",
      "  fovea ingest 'smoke_####.vdb' -o smoke.zarr\n"
      "  fovea ingest 'smoke_*.vdb' --grid density --grid temperature -o smoke.zarr\n"
      "  fovea ingest bonsai.raw --raw 256x256x256:uint8 -o bonsai.zarr\n"
      "  fovea ingest 'fmri_%04d.raw' --raw 64x64x21:int16:be --fps 0.5 -o fmri.zarr\n"
      "What is committed stays, whatever happens later: Ctrl-C loses at most the step in hand.");
  verb->add_option("input", command->ingest.inputs, "Files, globs, or 'smoke_####.vdb'")
      ->required()
      ->type_name("INPUT...");
  verb->add_option("-o,--output", command->ingest.output, "The dataset to make")
      ->required()
      ->type_name("DS.zarr");
  verb->add_option("--field", command->ingest.field,
                   "With --raw: what the values are called "
                   "(default density)")
      ->type_name("F");
  verb->add_option("--fps", command->ingest.frames_per_second,
                   "Frames a second: the time of a step is its number / this (default 24)")
      ->check(CLI::Range(1e-6, 1e6))
      ->type_name("R");
  verb->add_flag("--append", command->ingest.append, "Add steps to a dataset that is there");
  verb->add_option("--chunk", command->ingest.chunk_edge,
                   "Edge of a chunk: 8, 16 or 32 "
                   "coefficients (default 16)")
      ->check(CLI::IsMember({8, 16, 32}))
      ->type_name("C");
  AddBasisFlags(verb, &command->ingest);
  AddForeignFlags(verb, &command->ingest);
  AddThreadsFlag(verb, &command->ingest.threads);
  AddOutputFlags(verb, &command->output);
}

void AddLooking(CLI::App* app, Commands* commands) {
  CLI::App* info = AddVerb(app, "info", "What is inside a dataset, or what a server has",
                           "  fovea info smoke.zarr\n"
                           "  fovea info --server 127.0.0.1:50051\n"
                           "  fovea info --server 127.0.0.1:50051 smoke --json");
  info->add_option("dataset", commands->info.dataset,
                   "The dataset's folder, or its name on the server")
      ->type_name("DS.zarr");
  AddServerFlag(info, &commands->info.server);
  AddOutputFlags(info, &commands->info.output);

  CLI::App* stats = AddVerb(app, "stats", "Least and greatest value and histogram of each step",
                            "  fovea stats smoke.zarr\n"
                            "  fovea stats smoke.zarr --field temperature --steps 0-20x5 --json");
  AddDataset(stats, &commands->stats.dataset);
  AddFieldFlag(stats, &commands->stats.field);
  AddStepsFlag(stats, &commands->stats.steps);
  AddOutputFlags(stats, &commands->stats.output);

  CLI::App* verify = AddVerb(app, "verify", "Read everything and check every checksum",
                             "  fovea verify smoke.zarr\n"
                             "Ends with 1 if anything is damaged, and lists it.");
  AddDataset(verify, &commands->verify.dataset);
  AddThreadsFlag(verify, &commands->verify.threads);
  AddOutputFlags(verify, &commands->verify.output);
}

void AddExtract(CLI::App* app, ExtractCommand* command) {
  CLI::App* verb = AddVerb(
      app, "extract", "The voxels of a step back, as .npy or .raw",
      "  fovea extract smoke.zarr --step 3 -o step3.npy\n"
      "  fovea extract smoke.zarr --step 3 --box 0,0,0,16,16,16 -o corner.raw\n"
      "  fovea extract smoke.zarr --step 3 --fovea 19,19,20 --rate 16 -o foveated.npy\n"
      ".npy is float32 of shape (z, y, x); .raw the same bytes without a header, x fastest.");
  AddDataset(verb, &command->dataset);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(CLI::NonNegativeNumber)
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
  verb->add_option("-o,--output", command->file, "The file to write: .npy or .raw")
      ->required()
      ->type_name("FILE");
  AddOutputFlags(verb, &command->output);
}

void AddPlan(CLI::App* app, PlanCommand* command) {
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
      "From metadata alone. Coefficients, samples, chunks and bytes are exact, memory is an upper\n"
      "bound, milliseconds are a prediction. Of several budgets the tightest counts.");
  AddDataset(verb, &command->dataset);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(CLI::NonNegativeNumber)
      ->type_name("N");
  verb->add_option("--budget-ms", command->budget.ms, "Milliseconds, without encoding")
      ->check(CLI::PositiveNumber)
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
      ->check(CLI::PositiveNumber)
      ->type_name("M");
  AddPictureFlags(verb, &command->spec);
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
}

void AddRender(CLI::App* app, RenderCommand* command) {
  CLI::App* verb = AddVerb(
      app, "render", "One picture of one step",
      "  fovea render smoke.zarr -o smoke.png\n"
      "  fovea render smoke.zarr --step 30 --fovea 19,19,20 --rate 40 --view 30,20 -o f.exr\n"
      "  fovea render smoke.vdb -o smoke.jpg\n"
      "  fovea render bonsai.raw --raw 256x256x256:uint8 --size 1024x1024 -o bonsai.png\n"
      "  fovea render --server 127.0.0.1:50051 smoke --step 30 -o f.png\n"
      "The name chooses the format: .png .jpg are sRGB over the background; .exr .tif .npy are\n"
      "linear, premultiplied RGBA. What was not said is chosen, and printed as flags.");
  AddPictureInput(verb, &command->input);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(CLI::NonNegativeNumber)
      ->type_name("N");
  verb->add_option("-o,--output", command->file, "The picture: .png .jpg .exr .tif .npy")
      ->required()
      ->type_name("FILE");
  AddPictureFlags(verb, &command->spec);
  AddOutputFlags(verb, &command->output);
}

void AddExport(CLI::App* app, ExportCommand* command) {
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
                   "'f.####.png' (.jpg .exr .tif .npy), or a movie: .mp4 .mov .webm")
      ->required()
      ->type_name("FILE");
  verb->add_option("--animation", command->animation_file, "Keyframes of view, fovea, rate, step")
      ->type_name("FILE.json");
  verb->add_option("--orbit", command->orbit_deg, "Turn the view by so many degrees of azimuth")
      ->excludes("--animation")
      ->check(CLI::Range(-36000.0, 36000.0))
      ->type_name("DEGREES");
  verb->add_option("--orbit-frames", command->orbit_frames,
                   "Frames of the turn (default: one a step, or 120 of a single step)")
      ->needs("--orbit")
      ->check(CLI::Range(1, 1000000))
      ->type_name("N");
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
}

void AddBench(CLI::App* app, BenchCommand* command) {
  CLI::App* verb = AddVerb(
      app, "bench", "What a frame of your data costs, phase by phase, beside full resolution",
      "  fovea bench smoke.zarr\n"
      "  fovea bench smoke.zarr --step 30 --rate 25 --size 1024x1024 --rounds 9 --json\n"
      "Measures on one thread and on --threads, in turns; medians of the rounds. The store is\n"
      "in the page cache, and is read on all threads. A volume too large for full resolution is "
      "measured without it.");
  AddDataset(verb, &command->dataset);
  verb->add_option("--step", command->step, "Which step, from 0 (default 0)")
      ->check(CLI::NonNegativeNumber)
      ->type_name("N");
  verb->add_option("--rounds", command->rounds, "How often, 1 to 1000 (default 5)")
      ->check(CLI::Range(1, 1000))
      ->type_name("R");
  AddPictureFlags(verb, &command->spec);
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
}

void AddServeAndDemo(CLI::App* app, Commands* commands) {
  CLI::App* serve =
      app->add_subcommand("serve", "The gRPC service over all datasets below a folder");
  serve->set_help_flag();
  serve->prefix_command();

  CLI::App* demo =
      AddVerb(app, "demo", "No data at hand: makes a small moving volume and shows it",
              "  fovea demo --out demo\n"
              "Makes a plume of 24 steps, renders it with several foveas and rates, and\n"
              "(where ffmpeg is) as a movie.");
  DemoCommand* command = &commands->demo;
  demo->add_option("--out", command->folder,
                   "Where everything goes (default: a new folder in the "
                   "temporary one)")
      ->type_name("DIR");
  demo->add_option("--edge", command->edge_voxels, "Voxels a side, 16 to 512 (default 96)")
      ->check(CLI::Range(16, 512))
      ->type_name("N");
  demo->add_option("--steps", command->steps, "Steps, 1 to 1000 (default 24)")
      ->check(CLI::Range(1, 1000))
      ->type_name("N");
  AddThreadsFlag(demo, &command->threads);
  AddOutputFlags(demo, &command->output);
}

/// What is wrong with a command that the flags one by one cannot tell.
Status CheckInput(const PictureInput& input) {
  if (input.server && input.inputs.size() != 1) {
    return InvalidArgument("--server: name one dataset of the server, not {}", input.inputs.size());
  }
  return absl::OkStatus();
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

Status Check(BenchCommand* command) {
  if (command->spec.color_field) {
    return InvalidArgument("color_field: a benchmark measures one field; leave it out");
  }
  if (command->spec.mode) {
    return InvalidArgument("mode: a benchmark measures both; leave it out");
  }
  return frames::ValidateSpec(command->spec);
}

Status Check(InfoCommand* command) {
  if (command->dataset.empty() && !command->server) {
    return InvalidArgument("dataset is missing: name a folder, or a server with --server");
  }
  return absl::OkStatus();
}

template <typename T>
Status Check(T*) {
  return absl::OkStatus();
}

template <typename T>
ParseResult Checked(const char* verb, T* command) {
  const Status status = Check(command);
  if (!status.ok()) {
    return {std::nullopt, fmt::format("{}\nsee `fovea {} --help`", WithFlag(status), verb), 2};
  }
  return {std::move(*command), "", 0};
}

ParseResult Chosen(const CLI::App& app, Commands* commands) {
  const std::string verb = app.get_subcommands().front()->get_name();
  if (verb == "ingest") {
    return Checked("ingest", &commands->ingest);
  }
  if (verb == "info") {
    return Checked("info", &commands->info);
  }
  if (verb == "stats") {
    return Checked("stats", &commands->stats);
  }
  if (verb == "verify") {
    return Checked("verify", &commands->verify);
  }
  if (verb == "extract") {
    return Checked("extract", &commands->extract);
  }
  if (verb == "plan") {
    return Checked("plan", &commands->plan);
  }
  if (verb == "render") {
    return Checked("render", &commands->render);
  }
  if (verb == "export") {
    return Checked("export", &commands->exporting);
  }
  if (verb == "bench") {
    return Checked("bench", &commands->bench);
  }
  if (verb == "demo") {
    return Checked("demo", &commands->demo);
  }
  commands->serve.arguments = app.get_subcommands().front()->remaining();
  return Checked("serve", &commands->serve);
}

/// What is wrong with the verb itself, for which CLI11 has no good words; empty if nothing is.
std::string VerbProblem(const CLI::App& app, const std::vector<std::string>& arguments) {
  if (!arguments.empty() && arguments[0].starts_with('-')) {
    return "";
  }
  std::string verbs;
  for (const CLI::App* verb : app.get_subcommands(nullptr)) {
    if (!arguments.empty() && verb->get_name() == arguments[0]) {
      return "";
    }
    verbs += (verbs.empty() ? "" : ", ") + verb->get_name();
  }
  const std::string what =
      arguments.empty() ? "a verb is missing" : fmt::format("there is no verb '{}'", arguments[0]);
  return fmt::format("{}; there are: {}", what, verbs);
}

const char* InstructionSet() {
#if defined(__x86_64__)
  return "x86-64 baseline";
#elif defined(__aarch64__)
  return "AArch64 baseline";
#else
  return "baseline";
#endif
}

}  // namespace

ParseResult ParseCommandLine(const std::vector<std::string>& arguments) {
  CLI::App app("Fovea renders volumes foveated: sharp where you look, cheap everywhere else.",
               "fovea");
  app.require_subcommand(1);
  app.set_version_flag("--version", fmt::format("fovea {} ({})", FOVEA_VERSION, InstructionSet()));
  app.footer(
      "Start here:\n"
      "  fovea demo\n"
      "  fovea export 'smoke.####.vdb' -o smoke.mp4\n"
      "`fovea VERB --help` explains each verb. Exit status: 0 done, 1 failed, 2 wrong usage.");
  Commands commands;
  AddIngest(&app, &commands.ingest);
  AddLooking(&app, &commands);
  AddExtract(&app, &commands.extract);
  AddPlan(&app, &commands.plan);
  AddRender(&app, &commands.render);
  AddExport(&app, &commands.exporting);
  AddBench(&app, &commands.bench);
  AddServeAndDemo(&app, &commands);
  if (const std::string problem = VerbProblem(app, arguments); !problem.empty()) {
    return {std::nullopt, problem + "\nsee `fovea --help`", 2};
  }
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::CallForHelp&) {
    return {std::nullopt, app.help(), 0};
  } catch (const CLI::CallForVersion& version) {
    return {std::nullopt, version.what(), 0};
  } catch (const CLI::ParseError& error) {
    const auto verbs = app.get_subcommands();
    const std::string verb = verbs.empty() ? "" : " " + verbs.front()->get_name();
    return {std::nullopt, fmt::format("{}\nsee `fovea{} --help`", error.what(), verb),
            error.get_exit_code() == 1 ? 1 : 2};
  }
  return Chosen(app, &commands);
}

}  // namespace fovea::cli
