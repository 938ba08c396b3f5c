#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/picture_source.h"
#include "service/client/views_client.h"
#include "service/export/picture_file.h"
#include "service/frames/spec_json.h"

namespace fovea::cli {
namespace {

void PrintFrame(const RenderCommand& command, const frames::Frame& frame, const Int3& dims) {
  const std::string flags = PinningFlags(frame.used, dims);
  if (command.output.json) {
    nlohmann::json value = frames::FrameToJson(frame);
    value["output"] = command.file;
    value["flags"] = flags;
    PrintJson(value);
    return;
  }
  const frames::FrameStats& stats = frame.stats;
  PrintLine(fmt::format("{}: {}x{}, step {}{}, {:.6g} s", command.file, frame.width_px,
                        frame.height_px, frame.step,
                        frame.frame_number ? fmt::format(" (frame {})", *frame.frame_number) : "",
                        static_cast<double>(frame.time_ns) / 1e9));
  PrintLine("pinned by: " + flags);
  PrintLine(fmt::format("m {} coefficients, {} super-voxels, {} samples; {} of {} chunks read ({})",
                        stats.coefficients, stats.super_voxels, stats.samples, stats.chunks_read,
                        stats.chunks_total, HumanBytes(stats.bytes_read)));
  PrintLine(fmt::format(
      "read {:.1f} ms, reconstruct {:.1f}, render {:.1f}, smooth and warp {:.1f}, "
      "encode {:.1f}",
      stats.read_ms, stats.reconstruct_ms, stats.render_ms, stats.smooth_warp_ms, stats.encode_ms));
}

/// The same file again and again; the last one as without --refine.
Status Refine(const RenderCommand& command, exports::PictureFormat format) {
  const std::string& name = command.input.inputs.front();
  FOVEA_ASSIGN_OR_RETURN(const auto catalogue,
                         client::Client::Connect(*command.input.server, command.input.credentials));
  FOVEA_ASSIGN_OR_RETURN(const client::DatasetSummary dataset, catalogue->GetDataset(name));
  FOVEA_ASSIGN_OR_RETURN(const auto server, client::ViewsClient::Connect(
                                                *command.input.server, command.input.credentials));
  const Stopwatch watch;
  Status written;
  frames::Frame last;
  const auto on_frame = [&](const client::ViewFrame& now) {
    written = exports::WritePicture(command.file, format, now.frame);
    if (written.ok() && !now.final && command.output.json) {
      nlohmann::json value = frames::FrameToJson(now.frame);
      value["output"] = command.file;
      PrintJson(value);
    } else if (written.ok() && !now.final) {
      PrintLine(fmt::format("{}: rate {}, after {:.0f} ms", command.file,
                            FormatRate(*now.frame.used.rate), watch.ElapsedMs()));
    }
    std::fflush(stdout);
    last = now.frame;
    return written.ok() && !Interrupted();
  };
  FOVEA_RETURN_IF_ERROR(
      server->Refine({.dataset = name, .step = command.step, .spec = command.spec}, on_frame));
  FOVEA_RETURN_IF_ERROR(written);
  if (Interrupted()) {
    return Cancelled("stopped; {} stays as sharp as it is", command.file);
  }
  for (const frames::Warning& warning : last.warnings) {
    Warn(warning.message);
  }
  PrintFrame(command, last, dataset.info.hierarchy.dims());
  return absl::OkStatus();
}

}  // namespace

Status Run(const RenderCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto format, exports::PictureFormatOf(command.file));
  if (command.refine) {
    return Refine(command, format);
  }
  FOVEA_ASSIGN_OR_RETURN(const auto provider, OpenPictures(command.input, command.output));
  if (Interrupted()) {
    return Cancelled("stopped; {} was not written", command.file);
  }
  // There is nothing to keep before the picture is there: Ctrl-C may end the process at once.
  ResetSignalHandlers();
  FOVEA_ASSIGN_OR_RETURN(const frames::Frame frame, provider->Render(command.step, command.spec));
  InstallSignalHandlers();
  FOVEA_RETURN_IF_ERROR(exports::WritePicture(command.file, format, frame));
  for (const frames::Warning& warning : frame.warnings) {
    Warn(warning.message);
  }
  PrintFrame(command, frame, provider->info().hierarchy.dims());
  return absl::OkStatus();
}

}  // namespace fovea::cli
