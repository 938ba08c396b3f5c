#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include <nlohmann/json.hpp>

#include "engine/store/dataset_writer.h"
#include "engine/wavelet/haar.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/demo_volume.h"
#include "service/export/exporter.h"
#include "service/export/picture_file.h"

namespace fovea::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kFramesPerSecond = 24;

/// The folder to work in: the one asked for, or a new one.
StatusOr<std::string> MakeFolder(const std::string& asked) {
  std::error_code error;
  if (!asked.empty()) {
    fs::create_directories(asked, error);
    if (error) {
      return FailedPrecondition("--out: cannot make {}: {}", asked, error.message());
    }
    return asked;
  }
  std::string name = (fs::temp_directory_path(error) / "fovea-demo-XXXXXX").string();
  if (error || ::mkdtemp(name.data()) == nullptr) {
    return FailedPrecondition("cannot make a temporary folder: name one with --out");
  }
  return name;
}

Status WriteStore(const DemoCommand& command, const std::string& path) {
  store::DatasetInfo info;
  FOVEA_ASSIGN_OR_RETURN(info.hierarchy, Hierarchy::Make({command.edge_voxels, command.edge_voxels,
                                                          command.edge_voxels}));
  info.default_field = "density";
  info.fields = {{"density", "float32", 0, 0}};
  info.clock = "start of the demo";
  FOVEA_ASSIGN_OR_RETURN(const auto writer, store::DatasetWriter::Create(path, info));
  Progress progress(command.output, "making " + path, "steps");
  for (int64_t step = 0; step < command.steps; ++step) {
    const double phase = static_cast<double>(step) / static_cast<double>(command.steps);
    const BrickGrid voxels = DemoPlume(command.edge_voxels, phase, command.threads);
    FOVEA_RETURN_IF_ERROR(
        writer->WriteField("density", wavelet::ForwardHaar(voxels, info.hierarchy, command.threads),
                           ComputeStats(voxels)));
    const double time_ns = std::round(1e9 * static_cast<double>(step) / kFramesPerSecond);
    FOVEA_RETURN_IF_ERROR(writer->Commit(static_cast<int64_t>(time_ns), step));
    progress.Update(step + 1, command.steps);
    if (Interrupted()) {
      return Cancelled("stopped after {} of {}; they stay in {}", step + 1,
                       CountOf(command.steps, "step"), path);
    }
  }
  return absl::OkStatus();
}

frames::FrameSpec DemoView(double edge) {
  frames::FrameSpec spec;
  spec.view.azimuth_deg = 20;
  spec.view.elevation_deg = -10;
  spec.view.span_voxels = 1.2 * edge;
  return spec;
}

struct DemoPicture {
  const char* name;
  const char* shows;
  Vec3 fovea;  // in parts of the volume
  double rate;
};

/// The pictures that were made, each as {"path", "shows", "coefficients"}.
StatusOr<nlohmann::json> RenderPictures(const DemoCommand& command, const std::string& folder,
                                        exports::FrameProvider& provider) {
  const auto edge = static_cast<double>(command.edge_voxels);
  const DemoPicture pictures[] = {
      {"everything.png", "every coefficient", {0.5, 0.5, 0.5}, edge},
      {"fovea_middle.png", "fovea in the middle, rate 24", {0.5, 0.5, 0.5}, 24},
      {"fovea_low.png", "fovea at the foot, rate 24", {0.5, 0.5, 0.15}, 24},
      {"coarse.png", "fovea in the middle, rate 8", {0.5, 0.5, 0.5}, 8},
  };
  nlohmann::json made = nlohmann::json::array();
  for (const DemoPicture& picture : pictures) {
    frames::FrameSpec spec = DemoView(edge);
    spec.fovea = frames::Position{edge * picture.fovea};
    spec.rate = picture.rate;
    spec.fovea_marker = picture.rate < edge;
    FOVEA_ASSIGN_OR_RETURN(const frames::Frame frame, provider.Render(2 * command.steps / 3, spec));
    const std::string path = (fs::path(folder) / picture.name).string();
    FOVEA_RETURN_IF_ERROR(exports::WritePicture(path, exports::PictureFormat::kPng, frame));
    made.push_back({{"path", path},
                    {"shows", picture.shows},
                    {"coefficients", frame.stats.coefficients},
                    {"render_ms", frame.stats.render_ms}});
  }
  return made;
}

/// The movie's path; nothing, with a note, where ffmpeg is missing.
StatusOr<std::optional<std::string>> ExportMovie(const DemoCommand& command,
                                                 const std::string& folder,
                                                 exports::FrameProvider& provider) {
  exports::ExportOptions options;
  options.output = (fs::path(folder) / "plume.mp4").string();
  options.spec = DemoView(static_cast<double>(command.edge_voxels));
  options.overwrite = true;
  if (const Status tools = exports::CheckTools(options); !tools.ok()) {
    Note(command.output, fmt::format("note: no movie: {}", MessageOf(tools)));
    return std::optional<std::string>();
  }
  Progress progress(command.output, "movie", "frames");
  FOVEA_RETURN_IF_ERROR(exports::Export(provider, options, [&](const exports::ExportProgress& now) {
                          progress.Update(now.done, now.total);
                          return !Interrupted();
                        }).status());
  return std::optional<std::string>(options.output);
}

}  // namespace

Status Run(const DemoCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const std::string folder, MakeFolder(command.folder));
  const std::string dataset = (fs::path(folder) / "plume.zarr").string();
  std::error_code error;
  if (fs::exists(dataset, error)) {
    Note(command.output, fmt::format("{} is there already and is used", dataset));
  } else {
    FOVEA_RETURN_IF_ERROR(WriteStore(command, dataset));
  }
  FOVEA_ASSIGN_OR_RETURN(const auto provider, exports::OpenLocal(dataset, command.threads));
  FOVEA_ASSIGN_OR_RETURN(const nlohmann::json pictures, RenderPictures(command, folder, *provider));
  FOVEA_ASSIGN_OR_RETURN(const auto movie, ExportMovie(command, folder, *provider));

  if (command.output.json) {
    nlohmann::json value = {{"dataset", dataset}, {"pictures", pictures}};
    if (movie) {
      value["movie"] = *movie;
    }
    PrintJson(value);
    return absl::OkStatus();
  }
  PrintLine(fmt::format("dataset  {}", dataset));
  for (const nlohmann::json& picture : pictures) {
    PrintLine(fmt::format("picture  {}  ({}: {} coefficients, {:.1f} ms)",
                          picture["path"].get<std::string>(), picture["shows"].get<std::string>(),
                          picture["coefficients"].get<uint64_t>(),
                          picture["render_ms"].get<double>()));
  }
  if (movie) {
    PrintLine("movie    " + *movie);
  }
  PrintLine(fmt::format("next:    fovea render {} --view 60,10 --rate 16 -o view.png",
                        ShellQuote(dataset)));
  return absl::OkStatus();
}

}  // namespace fovea::cli
