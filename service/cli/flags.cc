#include "service/cli/flags.h"

#include <cmath>
#include <utility>

#include <CLI/CLI.hpp>

#include "ingest/quantise.h"
#include "service/cli/checks.h"
#include "service/cli/foreign_flags.h"

namespace fovea::cli {
namespace {

constexpr const char* kPictureGroup = "Picture (chosen from the dataset, and printed, if absent)";
constexpr const char* kServerGroup = "Of --server";

/// A flag whose text `parse` turns into a value for `use`; its errors name the flag.
template <typename Parse, typename Use>
CLI::Option* AddParsed(CLI::App* app, const std::string& flag, const char* type, Parse parse,
                       Use use, const char* help) {
  const auto callback = [flag, parse, use](const std::string& text) {
    auto value = parse(text);
    if (!value.ok()) {
      // What cannot be known from the command line alone (a file is not there) ends with 1.
      const std::string message = fmt::format("{}: {}", flag, MessageOf(value.status()));
      throw CLI::ValidationError(message, absl::IsInvalidArgument(value.status()) ? 2 : 1);
    }
    use(std::move(value).value());
  };
  return app->add_option_function<std::string>(flag, callback, help)->type_name(type);
}

/// Stores into anything that the value can be assigned to.
template <typename Target>
auto Into(Target* target) {
  return [target](auto&& value) { *target = std::forward<decltype(value)>(value); };
}

void AddPerspective(CLI::App* app, frames::ViewSpec* view) {
  // Parsing fills what --eye creates; CLI11 checks `needs` afterwards.
  const auto camera = [view]() -> frames::PerspectiveSpec& {
    return view->perspective ? *view->perspective : view->perspective.emplace();
  };
  CLI::Option* eye = AddParsed(
      app, "--eye", "X,Y,Z[w]", ParsePosition,
      [camera](const frames::Position& at) { camera().eye = at; },
      "Perspective view from this point, outside or inside the volume");
  eye->group(kPictureGroup)
      ->excludes(app->get_option("--view"))
      ->excludes(app->get_option("--span"))
      ->excludes(app->get_option("--center"));
  AddParsed(
      app, "--target", "X,Y,Z[w]", ParsePosition,
      [camera](const frames::Position& at) { camera().target = at; },
      "With --eye: what is in the middle of the picture (default: the volume's middle)")
      ->group(kPictureGroup)
      ->needs(eye);
  AddParsed(
      app, "--up", "X,Y,Z", ParseVector, [camera](const Vec3& up) { camera().up = up; },
      "With --eye: what is up in the picture, in world axes (default 0,0,1)")
      ->group(kPictureGroup)
      ->needs(eye);
  AddParsed(
      app, "--fov", "DEG", ParseNumber, [camera](double degrees) { camera().fov_y_deg = degrees; },
      "With --eye: field of view over the picture's height, 0.01 to 170 degrees (default 45)")
      ->group(kPictureGroup)
      ->needs(eye);
}

void AddView(CLI::App* app, frames::ViewSpec* view) {
  AddParsed(
      app, "--view", "AZ,EL", ParseView,
      [view](const std::pair<double, double>& angles) {
        view->azimuth_deg = angles.first;
        view->elevation_deg = angles.second;
      },
      "Direction of sight in degrees; 0,0 looks along +x with +z up")
      ->group(kPictureGroup);
  AddParsed(app, "--span", "VOXELS", ParseNumber, Into(&view->span_voxels),
            "How much the picture's height shows; smaller zooms in")
      ->group(kPictureGroup);
  AddParsed(app, "--center", "X,Y,Z[w]", ParsePosition, Into(&view->center),
            "What is in the middle of the picture (default: the volume's middle)")
      ->group(kPictureGroup);
  AddPerspective(app, view);
}

/// The numbers of one flag, the direction of the other.
void AddLighting(CLI::App* app, std::optional<render::Lighting>* lighting) {
  AddParsed(
      app, "--lighting", "A,D,S[,N]", ParseLighting,
      [lighting](const render::Lighting& parts) {
        const Vec3 to_light = *lighting ? (*lighting)->to_light : Vec3{};
        *lighting = parts;
        (*lighting)->to_light = to_light;
      },
      "Light surfaces: ambient, diffuse and specular part, 0 to 1, and shininess, 1 to 256 (alone: "
      "0.3,0.7,0.2,16)")
      ->expected(0, 1)
      ->group(kPictureGroup);
  AddParsed(
      app, "--light", "X,Y,Z", ParseDirection,
      [lighting](const Vec3& to_light) {
        *lighting = lighting->value_or(*ParseLighting(""));
        (*lighting)->to_light = to_light;
      },
      "Lighting from there, a direction in the world (default: beside the viewer)")
      ->group(kPictureGroup);
}

void AddClip(CLI::App* app, frames::ClipSpec* clip) {
  AddParsed(app, "--clip-box", "X0,Y0,Z0,X1,Y1,Z1[w]", ParseClipBox, Into(&clip->box),
            "Show only what lies in this box")
      ->group(kPictureGroup);
  const auto on_planes = [clip](const std::vector<std::string>& texts) {
    for (const std::string& text : texts) {
      auto plane = ParseClipPlane(text);
      if (!plane.ok()) {
        throw CLI::ValidationError(fmt::format("--clip-plane: {}", MessageOf(plane.status())), 2);
      }
      clip->planes.push_back(*plane);
    }
  };
  app->add_option_function<std::vector<std::string>>(
         "--clip-plane", on_planes,
         "Show only where N . (x,y,z) >= OFFSET; may be given up to 6 times")
      ->allow_extra_args(false)
      ->type_name("NX,NY,NZ,OFFSET[w]")
      ->group(kPictureGroup);
}

/// What shades, cuts and colours.
void AddOptions(CLI::App* app, frames::FrameSpec* spec) {
  AddParsed(app, "--compositing", "C", ParseCompositing, Into(&spec->compositing),
            "emission, or maximum: the largest value along each ray")
      ->group(kPictureGroup);
  AddLighting(app, &spec->lighting);
  AddClip(app, &spec->clip);
  app->add_option("--color-field", spec->color_field,
                  "A second field that gives the colours, while --field gives opacity")
      ->type_name("F")
      ->group(kPictureGroup);
  AddParsed(app, "--color-transfer", "TF", ParseTransfer, Into(&spec->color_transfer),
            "Transfer function of --color-field; its opacities are not used")
      ->group(kPictureGroup);
  AddParsed(app, "--mode", "M", ParseMode, Into(&spec->mode),
            "two-phase, fused (super-voxels are made as rays reach them: less memory; Haar only) "
            "or auto")
      ->group(kPictureGroup);
}

StatusOr<ingest::OnMissing> ParseOnMissing(const std::string& text) {
  if (text == "error") {
    return ingest::OnMissing::kError;
  }
  if (text == "skip") {
    return ingest::OnMissing::kSkip;
  }
  if (text == "hold") {
    return ingest::OnMissing::kHold;
  }
  return InvalidArgument("'{}' is not error, skip or hold", text);
}

StatusOr<Vec3> ParseSpacing(const std::string& text) {
  FOVEA_ASSIGN_OR_RETURN(const Vec3 spacing, ParseVector(text));
  for (int axis = 0; axis < 3; ++axis) {
    if (!(spacing[axis] > 0) || !std::isfinite(spacing[axis])) {
      return InvalidArgument("'{}': voxel sizes must be above 0", text);
    }
  }
  return spacing;
}

StatusOr<ingest::Registration> ParseRegistration(const std::string& text) {
  if (text == "index") {
    return ingest::Registration::kIndex;
  }
  if (text == "world") {
    return ingest::Registration::kWorld;
  }
  return InvalidArgument("'{}' is neither index nor world", text);
}

}  // namespace

void AddOutputFlags(CLI::App* app, OutputOptions* output) {
  app->add_flag("--json", output->json, "One JSON value on stdout, for machines");
  app->add_flag("-q,--quiet", output->quiet, "No progress and no notes on stderr; warnings stay");
}

void AddThreadsFlag(CLI::App* app, int* threads) {
  app->add_option("--threads", *threads, "Processors to use (default 0: all; same result)")
      ->check(Whole(0, 1024))
      ->type_name("N");
}

void AddServerFlags(CLI::App* app, std::optional<std::string>* server,
                    client::Credentials* credentials) {
  CLI::Option* asked =
      app->add_option("--server", *server,
                      "Ask this server instead of doing the work here; a dataset is then named as "
                      "the server lists it")
          ->type_name("HOST:PORT");
  const auto add = [&](const char* name, std::string* path, const char* help) {
    app->add_option(name, *path, help)->needs(asked)->type_name("FILE")->group(kServerGroup);
  };
  add("--tls-ca", &credentials->ca_file,
      "Encrypt, and trust a server that one of these authorities knows (PEM)");
  add("--tls-cert", &credentials->cert_file, "This client's certificate, if the server asks (PEM)");
  add("--tls-key", &credentials->key_file, "The key of --tls-cert (PEM)");
  add("--token-file", &credentials->token_file, "The token, if the server asks for one");
}

void AddFieldFlag(CLI::App* app, std::optional<std::string>* field) {
  app->add_option("--field", *field, "Which field (default: the dataset's own)")
      ->type_name("F")
      ->group(kPictureGroup);
}

void AddFoveaFlags(CLI::App* app, std::optional<frames::Position>* fovea, std::optional<Rate>* rate,
                   std::optional<WindowShape>* window) {
  AddParsed(app, "--fovea", "X,Y,Z[w]", ParsePosition, Into(fovea),
            "Where the detail is kept: voxels, or world units with a trailing w")
      ->group(kPictureGroup);
  AddParsed(
      app, "--rate", "R or RX,RY,RZ", ParseRate, Into(rate),
      "How wide the kept window is in every sub-band, 1 to 65536 coefficients; three numbers: "
      "along each axis")
      ->group(kPictureGroup);
  AddParsed(app, "--window", "SHAPE", ParseWindow, Into(window),
            "What is kept of it: cube (all), sphere (the ball as wide), or smooth (all, weighted "
            "down towards the border)")
      ->group(kPictureGroup);
}

void AddStepsFlag(CLI::App* app, StepRange* steps) {
  AddParsed(app, "--steps", "A-BxS", ParseSteps, Into(steps),
            "Steps A to B, B included, every S-th (default: all)");
}

void AddOrbitFlags(CLI::App* app, std::optional<double>* degrees, std::optional<int64_t>* frames) {
  app->add_option("--orbit", *degrees, "Turn the view by so many degrees of azimuth")
      ->excludes("--animation")
      ->check(Within(-36000, 36000))
      ->type_name("DEGREES");
  app->add_option("--orbit-frames", *frames,
                  "Frames of the turn (default: one a step, or 120 of a single step)")
      ->needs("--orbit")
      ->check(Whole(1, 1'000'000))
      ->type_name("N");
}

void AddPictureFlags(CLI::App* app, frames::FrameSpec* spec) {
  AddFieldFlag(app, &spec->field);
  AddFoveaFlags(app, &spec->fovea, &spec->rate, &spec->window);
  AddView(app, &spec->view);
  AddParsed(
      app, "--size", "WxH", ParseSize,
      [spec](const std::pair<int64_t, int64_t>& size) {
        spec->width_px = size.first;
        spec->height_px = size.second;
      },
      "Picture size in pixels, each 1 to 16384 (default 512x512)")
      ->group(kPictureGroup);
  AddParsed(app, "--transfer", "TF", ParseTransfer, Into(&spec->transfer),
            "Transfer function 'V:R,G,B:A;...' or a .json file: value, linear colour, opacity per "
            "voxel length")
      ->group(kPictureGroup);
  AddParsed(app, "--weighting", "D", ParseWeighting, Into(&spec->weighting),
            "none, chop (hide what is before the fovea) or falloff:A (opacity times 1/(1 + A "
            "distance))")
      ->group(kPictureGroup);
  AddParsed(
      app, "--reconstruction", "HOW", ParseReconstruction, Into(&spec->reconstruction),
      "exact, or fast: the inverse transform of CDF wavelets looks no further than the window")
      ->group(kPictureGroup);
  AddParsed(app, "--smoothing", "S", ParseSmoothing, Into(&spec->smoothing),
            "none (staircase), image, or full")
      ->group(kPictureGroup);
  AddParsed(app, "--basis", "B", ParseBasis, Into(&spec->basis),
            "What smoothing interpolates with: bilinear (default) or bspline (no creases, slower)")
      ->group(kPictureGroup);
  AddOptions(app, spec);
  AddParsed(app, "--background", "R,G,B", ParseColor, Into(&spec->background),
            "Linear colour behind the volume in .png, .jpg and movies (default 0,0,0)")
      ->group(kPictureGroup);
  app->add_option("--quality", spec->jpeg_quality, "Of .jpg, 1 to 100 (default 90)")
      ->type_name("Q")
      ->group(kPictureGroup);
  app->add_flag("--fovea-marker", spec->fovea_marker, "A red dot at the fovea")
      ->group(kPictureGroup);
  app->add_flag("--strict", spec->strict, "A damaged chunk is an error, not a warning")
      ->group(kPictureGroup);
}

void AddForeignFlags(CLI::App* app, ingest::IngestOptions* ingest) {
  AddParsed(app, "--raw", "FORMAT", ingest::ParseRawFormat, Into(&ingest->raw),
            "Files are headerless voxels, x fastest: NXxNYxNZ[xSTEPS]:TYPE[:le|be], such as "
            "256x256x225:uint8")
      ->group(kForeignGroup);
  app->add_option_function<int64_t>(
         "--header-bytes",
         [ingest](const int64_t& bytes) {
           if (!ingest->raw) {
             throw CLI::ValidationError("--header-bytes", "only means something with --raw");
           }
           ingest->raw->header_bytes = bytes;
         },
         "With --raw: bytes to skip at the start of each file")
      ->check(Whole(0))
      ->type_name("N")
      ->group(kForeignGroup);
  app->add_option("--grid", ingest->grids,
                  "VDB: a grid to take; may be given more than once "
                  "(default: every scalar grid)")
      ->allow_extra_args(false)
      ->type_name("NAME")
      ->group(kForeignGroup);
  AddParsed(app, "--spacing", "X,Y,Z", ParseSpacing, Into(&ingest->spacing),
            "All but VDB: size of a voxel in the world (default: as the file says, else 1,1,1)")
      ->group(kForeignGroup);
  app->add_option("--channel", ingest->channel,
                  "Of several values a voxel: which one, by number (from 0) or name; pictures: "
                  "also luminance, the default")
      ->type_name("C")
      ->group(kForeignGroup);
  app->add_option(
         "--axes", ingest->axes,
         "NumPy: what the axes of the array are, a letter of x, y, z, t (step), c (channel) "
         "each (default zyx or tzyx)")
      ->type_name("ZYX")
      ->group(kForeignGroup);
  app->add_option("--slices", ingest->slices_per_step,
                  "Pictures: so many slices make a step (default: as the files are)")
      ->check(Whole(1))
      ->type_name("N")
      ->group(kForeignGroup);
  AddParsed(app, "--on-missing", "WHAT", ParseOnMissing, Into(&ingest->on_missing),
            "A missing file or grid is an error, skip or hold: stop, leave it out, or show the "
            "step before (default error)")
      ->group(kForeignGroup);
  AddParsed(app, "--registration", "HOW", ParseRegistration, Into(&ingest->registration),
            "VDB grids or steps whose transforms differ: index (voxel i stays voxel i) or world "
            "(moved or resampled to where the first lie); without it they are an error")
      ->group(kForeignGroup);
  app->add_option("--worker-memory", ingest->worker.memory_bytes,
                  "Limit of the process that reads foreign files (default: by their size)")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->type_name("BYTES")
      ->group(kForeignGroup);
  app->add_option("--worker-seconds", ingest->worker.seconds_per_file,
                  "How long it may take for one file (default 120)")
      ->check(Positive())
      ->type_name("S")
      ->group(kForeignGroup);
  app->add_option(
         "--worker-cpu-seconds", ingest->worker.cpu_seconds_per_file,
         "How much processor time it may take for one file, all threads together (default: "
         "--worker-seconds on every processor)")
      ->check(Positive())
      ->type_name("S")
      ->group(kForeignGroup);
}

void AddTimeFlags(CLI::App* app, ingest::IngestOptions* ingest) {
  CLI::Option* times =
      AddParsed(app, "--times", "LIST|FILE", ParseTimes, Into(&ingest->times_s),
                "When the steps are, in seconds: one for each, such as 0,0.5,2, or a file of them");
  app->add_option("--fps", ingest->frames_per_second,
                  "Frames a second: the time of a step is its number / this (default: as the files "
                  "say, else 24)")
      ->check(Within(1e-6, 1e6))
      ->type_name("R")
      ->excludes(times);
}

void AddBasisFlags(CLI::App* app, ingest::IngestOptions* ingest) {
  AddParsed(app, "--wavelet", "W", ParseWavelet, Into(&ingest->wavelet),
            "haar, cdf53 or cdf97 (default haar; with --append, the dataset's)");
  app->add_flag("--lossless", ingest->lossless,
                "Reversible integer coefficients, haar or cdf53: for voxels of 8 or 16 bits");
  AddParsed(app, "--tolerance", "E", ingest::ParseTolerance, Into(&ingest->tolerance),
            "Quantised coefficients: no voxel is farther off than E (0.01: data units; 1e-3r or "
            "0.1%: of the range of the first step); verified, step by step");
}

void AddPartFlags(CLI::App* app, IngestCommand* command) {
  constexpr const char* kGroup = "Parts on several machines";
  app->add_option("--plan", command->plan, "Only look through the files, and write this plan")
      ->type_name("PLAN.json")
      ->group(kGroup);
  app->add_option("--from-plan", command->from_plan, "Take files and flags from this plan")
      ->type_name("PLAN.json")
      ->group(kGroup);
  AddParsed(app, "--shard", "I/N", ParseShard, Into(&command->shard),
            "With --from-plan: make part I, from 0, of N, in NAME.part-I-of-N.zarr")
      ->needs("--from-plan")
      ->group(kGroup);
}

void AddWatchFlags(CLI::App* app, IngestCommand* command) {
  constexpr const char* kGroup = "Live";
  CLI::Option* watch =
      app->add_flag("--watch", command->watch, "Take each new file of the series as it is finished")
          ->group(kGroup);
  app->add_option("--watch-seconds", command->watching.idle_seconds,
                  "End when no file came for so long (default: at Ctrl-C)")
      ->check(Positive())
      ->type_name("S")
      ->needs(watch)
      ->group(kGroup);
  app->add_option("--gap-seconds", command->watching.gap_seconds,
                  "How long a missing number is waited for, before --on-missing (default 30)")
      ->check(NotNegative())
      ->type_name("S")
      ->needs(watch)
      ->group(kGroup);
  app->add_option("--poll-seconds", command->watching.poll_seconds,
                  "How often the folder is looked through (default 1)")
      ->check(Within(0.01, 3600))
      ->type_name("S")
      ->needs(watch)
      ->group(kGroup);
}

void AddExtentFlag(CLI::App* app, std::optional<Box3>* extent) {
  AddParsed(app, "--extent", "X0,Y0,Z0,X1,Y1,Z1", ParseBox, Into(extent),
            "Box of a new dataset in the files' index space, upper corner not included (default: "
            "all that is active in any step)");
}

void AddRetainFlag(CLI::App* app, std::vector<store::AskedWindow>* windows) {
  const auto callback = [windows](const std::vector<std::string>& texts) {
    windows->clear();
    for (const std::string& text : texts) {
      const StatusOr<store::AskedWindow> window = ParseRetained(text);
      if (!window.ok()) {
        throw CLI::ValidationError("--retain", std::string(MessageOf(window.status())));
      }
      windows->push_back(*window);
    }
  };
  app->add_option_function<std::vector<std::string>>(
         "--retain", callback,
         "Keep only the detail around this fovea, as wide as this rate; give it again for more "
         "windows (default: keep all)")
      ->allow_extra_args(false)
      ->type_name("X,Y,Z[w]:RATE");
}

void AddPictureInput(CLI::App* app, PictureInput* input) {
  app->add_option("input", input->inputs,
                  "A dataset (NAME.zarr), or foreign files: names, globs, 'smoke.####.vdb'")
      ->required()
      ->type_name("INPUT...");
  AddServerFlags(app, &input->server, &input->credentials);
  app->add_flag("--foveated", input->foveated,
                "With --server: frames come as FOVEATED and are expanded here; the same pictures "
                "in fewer bytes")
      ->needs("--server")
      ->group(kServerGroup);
  app->add_flag("--local", input->local,
                "With --server: coefficients come, those that are not here yet, and are rendered "
                "here; the same pictures")
      ->needs("--server")
      ->excludes("--foveated")
      ->group(kServerGroup);
  AddThreadsFlag(app, &input->threads);
  AddForeignFlags(app, &input->ingest);
  app->add_option("--cache", input->cache,
                  "Where ingested foreign files are kept (default: fovea in $XDG_CACHE_HOME or "
                  "~/.cache)")
      ->type_name("DIR")
      ->group(kForeignGroup);
  app->parse_complete_callback([app, input] { RefuseForeignFlags(*app, input->inputs); });
}

}  // namespace fovea::cli
