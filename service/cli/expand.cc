#include <fstream>
#include <iterator>
#include <utility>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"
#include "service/export/picture_file.h"
#include "service/frames/foveated_codec.h"
#include "service/frames/foveated_picture.h"

namespace fovea::cli {
namespace {

StatusOr<std::string> ReadFrameFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("cannot read {}", path);
  }
  return std::string(std::istreambuf_iterator<char>(file), {});
}

}  // namespace

CLI::App* AddExpand(CLI::App* app, ExpandCommand* command) {
  CLI::App* verb =
      AddVerb(app, "expand", "A FOVEATED frame (.fvf) to the picture that it stands for",
              "  fovea render smoke.zarr --step 30 -o f.fvf\n"
              "  fovea expand f.fvf -o f.png\n"
              "The same picture, byte for byte, as `fovea render smoke.zarr --step 30 -o f.png`;\n"
              ".exr, .tif and .npy are as close as eight bits need. A JPEG has quality 90.");
  verb->add_option("frame", command->frame, "The frame, NAME.fvf")
      ->required()
      ->check(CLI::ExistingFile)
      ->type_name("FRAME.fvf");
  verb->add_option("-o,--output", command->file, "The picture: .png .jpg .exr .tif .npy")
      ->required()
      ->type_name("FILE");
  AddThreadsFlag(verb, &command->threads);
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(ExpandCommand* command) {
  const auto format = exports::PictureFormatOf(command->file);
  FOVEA_RETURN_IF_ERROR(Annotate(format.status(), "--output"));
  if (*format == exports::PictureFormat::kFoveated) {
    return InvalidArgument("--output: '{}' would be a FOVEATED frame again; name a picture",
                           command->file);
  }
  return absl::OkStatus();
}

Status Run(const ExpandCommand& command) {
  constexpr int kJpegQuality = 90;
  FOVEA_ASSIGN_OR_RETURN(const auto format, exports::PictureFormatOf(command.file));
  FOVEA_ASSIGN_OR_RETURN(const std::string bytes, ReadFrameFile(command.frame));
  auto picture = frames::DecodeFoveated(bytes);
  FOVEA_RETURN_IF_ERROR(Annotate(picture.status(), command.frame));
  frames::Frame frame;
  frame.encoding = exports::EncodingFor(format);
  frame.width_px = picture->width_px();
  frame.height_px = picture->height_px();
  const auto marker = picture->marker;
  const render::Color background = picture->background;
  render::Image image = frames::ExpandImage(*std::move(picture), command.threads);
  FOVEA_ASSIGN_OR_RETURN(
      frame.pixels,
      frames::EncodeMarked(std::move(image), marker, frame.encoding, background, kJpegQuality));
  FOVEA_RETURN_IF_ERROR(exports::WritePicture(command.file, format, frame));
  if (command.output.json) {
    PrintJson(nlohmann::json({{"frame", command.frame},
                              {"frame_bytes", bytes.size()},
                              {"output", command.file},
                              {"width_px", frame.width_px},
                              {"height_px", frame.height_px}}));
    return absl::OkStatus();
  }
  PrintLine(fmt::format("{}: {}x{} from {} of {}", command.file, frame.width_px, frame.height_px,
                        HumanBytes(bytes.size()), command.frame));
  return absl::OkStatus();
}

}  // namespace fovea::cli
