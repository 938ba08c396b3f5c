#include <absl/strings/str_split.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "service/cli/commands.h"

namespace fovea::cli {
namespace {

using ::testing::HasSubstr;

template <typename T>
T Parsed(const std::vector<std::string>& arguments) {
  const ParseResult result = ParseCommandLine(arguments);
  EXPECT_TRUE(result.command.has_value()) << result.text;
  return result.command ? std::get<T>(*result.command) : T{};
}

TEST(Parse, RenderTakesEveryPictureFlag) {
  const auto command = Parsed<RenderCommand>(
      {"render",         "a.zarr",      "--step",      "30",
       "--field",        "heat",        "--fovea",     "1,2,3w",
       "--rate",         "12.5",        "--view",      "-30,20",
       "--span",         "64",          "--center",    "4,5,6",
       "--size",         "320x200",     "--transfer",  "0:0,0,0:0;1:1,1,1:0.1",
       "--weighting",    "falloff:0.1", "--smoothing", "image",
       "--background",   "1,1,1",       "--quality",   "80",
       "--fovea-marker", "--strict",    "--threads",   "3",
       "--json",         "-q",          "-o",          "f.jpg"});
  EXPECT_EQ(command.input.inputs, std::vector<std::string>{"a.zarr"});
  EXPECT_EQ(command.input.threads, 3);
  EXPECT_EQ(command.step, 30);
  EXPECT_EQ(command.file, "f.jpg");
  const frames::FrameSpec& spec = command.spec;
  EXPECT_EQ(spec.field, "heat");
  EXPECT_EQ(spec.fovea, (frames::Position{{1, 2, 3}, true}));
  EXPECT_EQ(spec.rate, 12.5);
  EXPECT_EQ(spec.view.azimuth_deg, -30);
  EXPECT_EQ(spec.view.elevation_deg, 20);
  EXPECT_EQ(spec.view.span_voxels, 64);
  EXPECT_EQ(spec.view.center, (frames::Position{{4, 5, 6}}));
  EXPECT_EQ(spec.width_px, 320);
  EXPECT_EQ(spec.height_px, 200);
  EXPECT_EQ(spec.transfer->points.size(), 2U);
  EXPECT_EQ(spec.weighting->falloff_per_voxel, 0.1);
  EXPECT_EQ(spec.smoothing, render::Smoothing::kImage);
  EXPECT_EQ(spec.background, (render::Color{1, 1, 1}));
  EXPECT_EQ(spec.jpeg_quality, 80);
  EXPECT_TRUE(spec.fovea_marker && spec.strict);
  EXPECT_EQ(spec.encoding, frames::Encoding::kJpeg);
  EXPECT_TRUE(command.output.json && command.output.quiet);
}

TEST(Parse, NumbersThatAreWrongAreToldInAFewWords) {
  for (const auto& [line, problem] : std::vector<std::pair<const char*, const char*>>{
           {"render a.zarr -o f.png --step -1", "--step: '-1' is not a whole number, 0 or more"},
           {"render a.zarr -o f.png --step 1.5", "--step: '1.5' is not a whole number, 0 or more"},
           {"render a.zarr -o f.png --step 99999999999999999999",
            "--step: '99999999999999999999' is not a whole number, 0 or more"},
           {"render a.zarr -o f.png --threads 2000",
            "--threads: '2000' is not a whole number from 0 to 1024"},
           {"jobs ingest a --dataset b --server h:1 --tolerance 0.1%",
            "--tolerance: '0.1%' is not a number above 0"},
           {"jobs ingest a --dataset b --server h:1 --tolerance inf",
            "--tolerance: 'inf' is not a number above 0"},
           {"jobs export a -o f.#.png --server h:1 --fps nan",
            "--fps: 'nan' is not a number from 0.01 to 1000"},
           {"render a.zarr -o f.jpg --quality 1.5",
            "--quality: '1.5' is not a number that it takes"},
       }) {
    const ParseResult result = ParseCommandLine(absl::StrSplit(line, ' '));
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_EQ(result.text.substr(0, result.text.find('\n')), problem);
  }
}

TEST(Parse, SensorsTakesEveryFlag) {
  const auto command = Parsed<SensorsCommand>(absl::StrSplit(
      "sensors a.csv b.csv -o x.zarr --format jsonl --columns "
      "time=when,x=lon,y=lat,value=T,value=rh --separator tab --time-unit ms "
      "--max-bad 7 --field t,h --value-range -5,60.5 --duplicates mean --bounds "
      "-1,-2,-3,4,5,6 --voxel 0.5,0.5,0.25 --reach 8 --background -32 --step-seconds "
      "60 --start 1970-01-01T00:00:30Z --watermark 5 --on-missing hold --most-ahead "
      "9 --world-unit m --value-unit dBZ --clock UTC --chunk 8 --json",
      ' '));
  const ingest::SensorOptions& ingest = command.ingest;
  EXPECT_EQ(ingest.inputs, (std::vector<std::string>{"a.csv", "b.csv"}));
  EXPECT_EQ(ingest.format, ingest::ReadingFormat::kJsonLines);
  EXPECT_EQ(ingest.columns.time, "when");
  EXPECT_EQ(ingest.columns.values, (std::vector<std::string>{"T", "rh"}));
  EXPECT_EQ(ingest.separator, '\t');
  EXPECT_EQ(ingest.time_unit_s, 1e-3);
  EXPECT_EQ(ingest.max_bad, 7);
  EXPECT_EQ(ingest.fields, (std::vector<std::string>{"t", "h"}));
  EXPECT_EQ(ingest.least_value, -5);
  EXPECT_EQ(ingest.greatest_value, 60.5);
  EXPECT_EQ(ingest.duplicates, sensors::Duplicates::kMean);
  EXPECT_EQ((*ingest.box.bounds)[0], (Vec3{-1, -2, -3}));
  EXPECT_EQ(ingest.box.voxel, (Vec3{0.5, 0.5, 0.25}));
  EXPECT_EQ(ingest.fill.reach_voxels, 8);
  EXPECT_EQ(ingest.fill.background, -32);
  EXPECT_EQ(ingest.steps_by, ingest::StepsBy::kWindow);
  EXPECT_EQ(ingest.steps.window_s, 60);
  EXPECT_EQ(ingest.steps.start_s, 30);
  EXPECT_EQ(ingest.steps.watermark_s, 5);
  EXPECT_EQ(ingest.steps.most_ahead, 9);
  EXPECT_EQ(ingest.steps.on_empty, sensors::OnEmpty::kHold);
  EXPECT_EQ(ingest.world_unit, "m");
  EXPECT_EQ(ingest.value_unit, "dBZ");
  EXPECT_EQ(ingest.clock, "UTC");
  EXPECT_EQ(ingest.chunk_edge, 8);
  const auto plain = Parsed<SensorsCommand>({"sensors", "-", "-o", "x.zarr", "--step-key", "scan"});
  EXPECT_EQ(plain.ingest.steps_by, ingest::StepsBy::kKey);
}

TEST(Parse, PerspectiveViews) {
  const auto render =
      Parsed<RenderCommand>({"render", "a.zarr", "--fov", "60", "--up", "0,1,0", "--target",
                             "4,5,6w", "--eye", "-1,2,3", "-o", "f.png"});
  EXPECT_EQ(render.spec.view.perspective,
            (frames::PerspectiveSpec{
                {{-1, 2, 3}}, frames::Position{{4, 5, 6}, true}, Vec3{0, 1, 0}, 60}));
  const auto refused = [](const std::vector<std::string>& flags, const char* text) {
    std::vector<std::string> arguments = {"render", "a.zarr", "-o", "f.png"};
    arguments.insert(arguments.end(), flags.begin(), flags.end());
    const ParseResult bad = ParseCommandLine(arguments);
    EXPECT_EQ(bad.exit_status, 2);
    EXPECT_THAT(bad.text, HasSubstr(text));
  };
  refused({"--fov", "60"}, "--eye");
  refused({"--eye", "1,2,3", "--view", "0,0"}, "--view");
  refused({"--eye", "1,2"}, "--eye: '1,2'");
  refused({"--eye", "1,2,3", "--fov", "180"},
          "--fov: fov_y_deg 180 is outside its range, 0.01 to 170");
}

TEST(Parse, WindowsAndARateAnAxis) {
  const auto render = Parsed<RenderCommand>({"render", "a.zarr", "--rate", "9,8,7", "--window",
                                             "smooth", "--basis", "bspline", "-o", "f.png"});
  EXPECT_EQ(render.spec.rate, Rate(9, 8, 7));
  EXPECT_EQ(render.spec.window, WindowShape::kSmooth);
  EXPECT_EQ(render.spec.basis, render::Basis::kBspline);
  const auto extract =
      Parsed<ExtractCommand>({"extract", "a.zarr", "--window", "sphere", "-o", "x.npy"});
  EXPECT_EQ(extract.window, WindowShape::kSphere);
  const ParseResult bad = ParseCommandLine({"render", "a.zarr", "--rate", "9,0,7", "-o", "f.png"});
  EXPECT_EQ(bad.exit_status, 2);
  EXPECT_THAT(bad.text, HasSubstr("--rate: rate 9,0,7 is outside its range, 1 to 65536"));
}

TEST(Parse, BenchTakesPictureFlagsAndRounds) {
  const auto command = Parsed<BenchCommand>({"bench", "a.zarr", "--step", "3", "--rate", "25",
                                             "--size", "64x32", "--threads", "2", "--rounds", "9"});
  EXPECT_EQ(command.dataset, "a.zarr");
  EXPECT_EQ(command.step, 3);
  EXPECT_EQ(command.spec.rate, 25);
  EXPECT_EQ(command.spec.height_px, 32);
  EXPECT_EQ(command.threads, 2);
  EXPECT_EQ(command.rounds, 9);
  EXPECT_EQ(ParseCommandLine({"bench", "a.zarr", "--rounds", "0"}).exit_status, 2);
}

TEST(Parse, WhatShadesCutsAndColours) {
  const auto spec = Parsed<RenderCommand>({"render",
                                           "a.zarr",
                                           "--light",
                                           "-1,0,2",
                                           "--lighting",
                                           "0.1,0.5,0,64",
                                           "--clip-box",
                                           "-1,0,0,8,9,10.5w",
                                           "--clip-plane",
                                           "-1,0,0,-20",
                                           "--clip-plane",
                                           "0,1,1,5w",
                                           "--color-field",
                                           "heat",
                                           "--color-transfer",
                                           "0:0,0,0:0;1:1,0,0:1",
                                           "--mode",
                                           "fused",
                                           "-o",
                                           "f.png"})
                        .spec;
  EXPECT_EQ(spec.lighting, (render::Lighting{true, 0.1F, 0.5F, 0, 64, {-1, 0, 2}}));
  EXPECT_EQ(spec.clip.box, (frames::ClipBox{{-1, 0, 0}, {8, 9, 10.5}, true}));
  EXPECT_EQ(spec.clip.planes,
            (std::vector<frames::ClipPlane>{{{-1, 0, 0}, -20, false}, {{0, 1, 1}, 5, true}}));
  EXPECT_EQ(spec.color_field, "heat");
  EXPECT_EQ(spec.color_transfer->points.size(), 2U);
  EXPECT_EQ(spec.mode, frames::Mode::kFused);
  const auto exported = Parsed<ExportCommand>(
      {"export", "a.zarr", "--compositing", "maximum", "--mode", "auto", "-o", "f.mp4"});
  EXPECT_EQ(exported.spec.compositing, render::Compositing::kMaximum);
  EXPECT_EQ(exported.spec.mode, frames::Mode::kAuto);
}

TEST(Parse, LightingNeedsNoNumbers) {
  const render::Lighting plain{true, 0.3F, 0.7F, 0.2F, 16, {}};
  EXPECT_EQ(Parsed<RenderCommand>({"render", "a.zarr", "--lighting", "-o", "f.png"}).spec.lighting,
            plain);
  EXPECT_EQ(Parsed<RenderCommand>({"render", "a.zarr", "-o", "f.png", "--lighting"}).spec.lighting,
            plain);
  const auto lit =
      Parsed<RenderCommand>({"render", "a.zarr", "--light", "1,2,3", "-o", "f.png"}).spec.lighting;
  EXPECT_EQ(lit, (render::Lighting{true, 0.3F, 0.7F, 0.2F, 16, {1, 2, 3}}));
}

TEST(Parse, NothingSaidIsNothingSet) {
  const auto command = Parsed<RenderCommand>({"render", "a.zarr", "-o", "f.npy"});
  frames::FrameSpec expected;
  expected.encoding = frames::Encoding::kRawRgbaF32;
  EXPECT_EQ(command.spec, expected);
  EXPECT_FALSE(command.input.server.has_value());
}

TEST(Parse, IngestTakesAWavelet) {
  const auto command = Parsed<IngestCommand>(
      {"ingest", "a.vdb", "-o", "x.zarr", "--wavelet", "cdf53", "--lossless"});
  EXPECT_EQ(command.ingest.wavelet, Wavelet::kCdf53);
  EXPECT_TRUE(command.ingest.lossless);
  EXPECT_FALSE(Parsed<IngestCommand>({"ingest", "a.vdb", "-o", "x.zarr"}).ingest.wavelet);
  EXPECT_TRUE(Parsed<IngestCommand>({"ingest", "a.vdb", "-o", "x.zarr", "--append"}).ingest.append);
}

TEST(Parse, IngestTakesRawFormats) {
  const auto command = Parsed<IngestCommand>({"ingest",
                                              "a.raw",
                                              "b.raw",
                                              "-o",
                                              "x.zarr",
                                              "--raw",
                                              "4x5x6:int16:be",
                                              "--header-bytes",
                                              "62",
                                              "--spacing",
                                              "1,1,2.5",
                                              "--field",
                                              "ct",
                                              "--fps",
                                              "2",
                                              "--on-missing",
                                              "hold",
                                              "--chunk",
                                              "8",
                                              "--worker-memory",
                                              "2GB",
                                              "--worker-seconds",
                                              "9",
                                              "--worker-cpu-seconds",
                                              "30"});
  const ingest::IngestOptions& options = command.ingest;
  EXPECT_EQ(options.inputs, (std::vector<std::string>{"a.raw", "b.raw"}));
  ASSERT_TRUE(options.raw.has_value());
  EXPECT_EQ(options.raw->dims, (Int3{4, 5, 6}));
  EXPECT_TRUE(options.raw->big_endian);
  EXPECT_EQ(options.raw->header_bytes, 62);
  EXPECT_EQ(options.spacing, (Vec3{1, 1, 2.5}));
  EXPECT_EQ(options.field, "ct");
  EXPECT_EQ(options.frames_per_second, 2);
  EXPECT_EQ(options.on_missing, ingest::OnMissing::kHold);
  EXPECT_EQ(options.chunk_edge, 8);
  EXPECT_EQ(options.worker.memory_bytes, int64_t{2} << 30);
  EXPECT_EQ(options.worker.seconds_per_file, 9);
  EXPECT_EQ(options.worker.cpu_seconds_per_file, 30);
}

TEST(Parse, GridsMayBeNamedMoreThanOnceBetweenInputs) {
  const auto command = Parsed<IngestCommand>(
      {"ingest", "--grid", "density", "a.vdb", "--grid", "heat", "b.vdb", "-o", "x.zarr"});
  EXPECT_EQ(command.ingest.grids, (std::vector<std::string>{"density", "heat"}));
  EXPECT_EQ(command.ingest.inputs, (std::vector<std::string>{"a.vdb", "b.vdb"}));
}

TEST(Parse, ExportAndTheOthers) {
  const auto command = Parsed<ExportCommand>({"export", "a.zarr", "--steps", "2-9x3", "--shard",
                                              "1/2", "--orbit", "90", "--orbit-frames", "12",
                                              "--fps", "30", "--overwrite", "-o", "f.####.exr"});
  EXPECT_EQ(command.steps, (StepRange{2, 9, 3}));
  EXPECT_EQ(command.shard, (Shard{1, 2}));
  EXPECT_EQ(command.orbit_deg, 90);
  EXPECT_EQ(command.orbit_frames, 12);
  EXPECT_EQ(command.frames_per_second, 30);
  EXPECT_TRUE(command.overwrite);
  EXPECT_EQ(Parsed<InfoCommand>({"info", "--server", "h:1"}).server, "h:1");
  EXPECT_EQ(Parsed<StatsCommand>({"stats", "a.zarr", "--steps", "3"}).steps, (StepRange{3, 3, 1}));
  EXPECT_EQ(Parsed<VerifyCommand>({"verify", "a.zarr"}).dataset, "a.zarr");
  EXPECT_EQ(
      Parsed<ExtractCommand>({"extract", "a.zarr", "--box", "0,0,0,1,2,3", "-o", "x.raw"}).box,
      (Box3{{0, 0, 0}, {1, 2, 3}}));
  EXPECT_EQ(Parsed<DemoCommand>({"demo", "--out", "d", "--steps", "4"}).steps, 4);
}

TEST(Parse, HowToBeLetInIsForServersOnly) {
  const std::vector<std::string> flags = {"--tls-ca",  "a", "--tls-cert",   "b",
                                          "--tls-key", "c", "--token-file", "d"};
  const auto with = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), flags.begin(), flags.end());
    return arguments;
  };
  for (const client::Credentials& credentials :
       {Parsed<InfoCommand>(with({"info", "--server", "h:1"})).credentials,
        Parsed<RenderCommand>(with({"render", "a", "--server", "h:1", "-o", "f.png"}))
            .input.credentials,
        Parsed<ExportCommand>(with({"export", "a", "--server", "h:1", "-o", "f.##.png"}))
            .input.credentials}) {
    EXPECT_EQ(credentials.ca_file, "a");
    EXPECT_EQ(credentials.cert_file, "b");
    EXPECT_EQ(credentials.key_file, "c");
    EXPECT_EQ(credentials.token_file, "d");
  }
  const ParseResult without = ParseCommandLine(with({"info", "a.zarr"}));
  EXPECT_EQ(without.exit_status, 2);
  EXPECT_THAT(without.text, HasSubstr("--server"));
}

TEST(Parse, TokenTakesEveryFlag) {
  const auto command = Parsed<TokenCommand>(
      {"token", "lab", "--tokens", "t.json", "--prefix", "a/b", "--rights", "write", "--streams",
       "3", "--pixels-per-second", "2e7", "--bytes-in-per-second", "5"});
  EXPECT_EQ(command.file, "t.json");
  EXPECT_EQ(command.token.name, "lab");
  EXPECT_EQ(command.token.prefix, "a/b");
  EXPECT_EQ(command.token.right, access::Right::kWrite);
  EXPECT_EQ(command.token.quotas, (access::Quotas{3, 2e7, 5}));
  EXPECT_EQ(Parsed<TokenCommand>({"token", "lab", "--tokens", "t.json"}).token.right,
            access::Right::kRead);
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{"token", "lab"},
                                             {"token", "a b", "--tokens", "t"},
                                             {"token", "lab", "--tokens", "t", "--prefix", "/a"},
                                             {"token", "lab", "--tokens", "t", "--rights", "all"},
                                             {"token", "lab", "--tokens", "t", "--streams", "0"}}) {
    EXPECT_EQ(ParseCommandLine(wrong).exit_status, 2) << wrong.back();
  }
}

TEST(Parse, ServePassesEverythingOn) {
  const auto command = Parsed<ServeCommand>({"serve", "root", "--listen", "127.0.0.1:0", "--help"});
  EXPECT_EQ(command.arguments,
            (std::vector<std::string>{"root", "--listen", "127.0.0.1:0", "--help"}));
}

TEST(Parse, HelpAndVersionEndWithZero) {
  const ParseResult version = ParseCommandLine({"--version"});
  EXPECT_EQ(version.exit_status, 0);
  EXPECT_THAT(version.text, HasSubstr("baseline"));
  for (const char* verb :
       {"ingest", "info", "stats", "verify", "extract", "render", "export", "demo"}) {
    const ParseResult help = ParseCommandLine({verb, "--help"});
    EXPECT_EQ(help.exit_status, 0) << verb;
    EXPECT_FALSE(help.command.has_value());
    EXPECT_THAT(help.text, HasSubstr("Examples:\n  fovea "));
    EXPECT_THAT(ParseCommandLine({"--help"}).text, HasSubstr(verb));
  }
}

struct Wrong {
  std::vector<std::string> arguments;
  std::string text;
};

TEST(Parse, WrongUsageEndsWithTwoAndNamesTheFlag) {
  const std::vector<Wrong> wrongs = {
      {{}, "a verb is missing; there are: ingest, sensors"},
      {{"dance"}, "there is no verb 'dance'"},
      {{"render", "-o", "f.png"}, "input is required"},
      {{"render", "a.zarr"}, "--output is required"},
      {{"render", "a.zarr", "-o", "f.gif"}, "--output: 'f.gif'"},
      {{"render", "a.zarr", "-o", "f.png", "--rate", "0"}, "rate 0 is outside its range"},
      {{"render", "a.zarr", "-o", "f.png", "--rate", "nan"}, "rate nan"},
      {{"render", "a.zarr", "-o", "f.png", "--rate", "many"}, "--rate: 'many'"},
      {{"render", "a.zarr", "-o", "f.png", "--size", "100000x100000"}, "width_px 100000"},
      {{"render", "a.zarr", "-o", "f.png", "--fovea", "1,2"}, "--fovea: '1,2'"},
      {{"render", "a.zarr", "-o", "f.png", "--fovea", "1,2,inf"}, "fovea inf"},
      {{"render", "a.zarr", "-o", "f.png", "--view", "0,91"}, "elevation_deg 91"},
      {{"render", "a.zarr", "-o", "f.png", "--transfer", "x"}, "--transfer"},
      {{"render", "a.zarr", "-o", "f.png", "--step", "-1"}, "--step"},
      {{"render", "a.zarr", "-o", "f.png", "--stride", "2"}, "--stride"},
      {{"render", "a.zarr", "-o", "f.exr", "--fovea-marker"}, "fovea_marker"},
      {{"render", "--lighting", "a.zarr", "-o", "f.png"}, "--lighting: 'a.zarr'"},
      {{"render", "a.zarr", "-o", "f.png", "--lighting", "2,0,0"},
       "--lighting: lighting.ambient 2"},
      {{"render", "a.zarr", "-o", "f.png", "--lighting", "1,0,0,3"}, "--lighting: lighting.shini"},
      {{"render", "a.zarr", "-o", "f.png", "--light", "1,2"}, "--light: '1,2'"},
      {{"render", "a.zarr", "-o", "f.png", "--light", "1,2,inf"}, "--lighting: lighting.to_light"},
      {{"render", "a.zarr", "-o", "f.png", "--compositing", "mip"}, "--compositing: 'mip'"},
      {{"render", "a.zarr", "-o", "f.png", "--compositing", "maximum", "--lighting"},
       "--lighting: lighting lights surfaces"},
      {{"render", "a.zarr", "-o", "f.png", "--compositing", "maximum", "--weighting", "falloff:1"},
       "--weighting: weighting falloff does not go"},
      {{"render", "a.zarr", "-o", "f.png", "--clip-box", "1,2,3,4,5"}, "--clip-box: '1,2,3,4,5'"},
      {{"render", "a.zarr", "-o", "f.png", "--clip-box", "1,2,3,4,2,6"},
       "--clip-box: clip_box: its y runs from 2 to 2"},
      {{"render", "a.zarr", "-o", "f.png", "--clip-plane", "1,0,0"}, "--clip-plane: '1,0,0'"},
      {{"render", "a.zarr", "-o", "f.png", "--clip-plane", "0,0,0,1"},
       "--clip-plane: clip_plane 0"},
      {{"render", "a.zarr", "-o", "f.png", "--color-transfer", "0:0,0,0:0"},
       "--color-transfer: color_transfer_function is given without a color_field"},
      {{"render", "a.zarr", "-o", "f.png", "--mode", "three"}, "--mode: 'three'"},
      {{"render", "a", "b", "--server", "h:1", "-o", "f.png"}, "--server"},
      {{"export", "a.zarr", "-o", "f.png"}, "no place for the frame's number"},
      {{"export", "a.zarr", "-o", "f.mp4", "--shard", "0/2"}, "shard 0/2"},
      {{"export", "a.zarr", "-o", "f.mp4", "--steps", "5-3"}, "--steps: '5-3'"},
      {{"export", "a.zarr", "-o", "f.mp4", "--orbit", "9", "--animation", "a.json"}, "--orbit"},
      {{"ingest", "a.raw", "-o", "x.zarr", "--raw", "4x5:uint8"}, "--raw"},
      {{"ingest", "a.raw", "-o", "x.zarr", "--header-bytes", "4"}, "--header-bytes"},
      {{"ingest", "a.raw", "-o", "x.zarr", "--chunk", "7"}, "--chunk"},
      {{"extract", "a.zarr", "-o", "x.txt"}, "--output"},
      {{"info"}, "dataset is missing"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--columns", "lon=x"}, "--columns: 'lon=x'"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--voxel", "1,0,1"}, "--voxel: a voxel of size 0"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--voxel", "1", "--dims", "8,8,8"}, "--dims"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--append", "--voxel", "1"}, "--append"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--step-key", "k", "--step-seconds", "1"},
       "--step-key"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--start", "noon"}, "--start: 'noon'"},
      {{"sensors", "a.csv", "-o", "x.zarr", "--duplicates", "first"}, "none of last, mean"},
  };
  for (const Wrong& wrong : wrongs) {
    const ParseResult result = ParseCommandLine(wrong.arguments);
    EXPECT_FALSE(result.command.has_value()) << wrong.text;
    EXPECT_EQ(result.exit_status, 2) << wrong.text;
    EXPECT_THAT(result.text, HasSubstr(wrong.text));
    EXPECT_THAT(result.text, HasSubstr("--help`"));
  }
}

}  // namespace
}  // namespace fovea::cli
