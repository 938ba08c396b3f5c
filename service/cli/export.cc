#include <fstream>
#include <iterator>

#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/orbit.h"
#include "service/cli/picture_source.h"
#include "service/export/exporter.h"

namespace fovea::cli {
namespace {

StatusOr<frames::Animation> ReadAnimation(const std::string& path) {
  constexpr size_t kMaxBytes = 16 << 20;
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("--animation: cannot open {}", path);
  }
  std::string text(kMaxBytes, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(file.gcount()));
  auto animation = frames::Animation::Parse(text);
  return animation.ok() ? std::move(animation)
                        : Annotate(animation.status(), fmt::format("--animation: {}", path));
}

void PrintReport(const ExportCommand& command, const exports::ExportReport& report,
                 const std::string& flags, double seconds) {
  const frames::FrameStats& totals = report.totals;
  if (command.output.json) {
    nlohmann::json warnings = nlohmann::json::array();
    for (const frames::Warning& warning : report.warnings) {
      warnings.push_back({{"message", warning.message}, {"count", warning.count}});
    }
    PrintJson(nlohmann::json({{"output", command.file},
                              {"first_path", report.first_path},
                              {"last_path", report.last_path},
                              {"frames_total", report.frames_total},
                              {"frames_made", report.frames_made},
                              {"frames_skipped", report.frames_skipped},
                              {"frames_per_second", report.frames_per_second},
                              {"flags", flags},
                              {"notes", report.notes},
                              {"warnings", warnings},
                              {"chunks_read", totals.chunks_read},
                              {"bytes_read", totals.bytes_read},
                              {"read_ms", totals.read_ms},
                              {"reconstruct_ms", totals.reconstruct_ms},
                              {"render_ms", totals.render_ms},
                              {"smooth_warp_ms", totals.smooth_warp_ms},
                              {"encode_ms", totals.encode_ms},
                              {"total_ms", seconds * 1000}}));
    return;
  }
  const std::string where = report.first_path == report.last_path
                                ? report.first_path
                                : report.first_path + " to " + report.last_path;
  PrintLine(fmt::format("{}: {} frames, {} made in {}", where, report.frames_total,
                        report.frames_made, HumanSeconds(seconds)));
  if (report.frames_made > 0) {
    const auto frames = static_cast<double>(report.frames_made);
    PrintLine(fmt::format(
        "a frame: read {:.1f} ms, reconstruct {:.1f}, render {:.1f}, smooth and "
        "warp {:.1f}, encode {:.1f}",
        totals.read_ms / frames, totals.reconstruct_ms / frames, totals.render_ms / frames,
        totals.smooth_warp_ms / frames, totals.encode_ms / frames));
  }
}

}  // namespace

Status Run(const ExportCommand& command) {
  const Stopwatch watch;
  exports::ExportOptions options;
  options.output = command.file;
  options.first = command.steps.first;
  options.last = command.steps.last;
  options.stride = command.steps.stride;
  options.frames_per_second = command.frames_per_second;
  options.shard_index = command.shard.index;
  options.shard_count = command.shard.count;
  options.overwrite = command.overwrite;
  if (command.animation_file) {
    FOVEA_ASSIGN_OR_RETURN(options.animation, ReadAnimation(*command.animation_file));
  }
  FOVEA_RETURN_IF_ERROR(exports::CheckTools(options));
  FOVEA_ASSIGN_OR_RETURN(const auto provider, OpenPictures(command.input, command.output));
  FOVEA_ASSIGN_OR_RETURN(options.spec, provider->Resolve(command.spec));
  const store::DatasetInfo& info = provider->info();
  if (command.orbit_deg) {
    options.animation = MakeOrbit({*command.orbit_deg, command.orbit_frames}, options.spec,
                                  info.index_to_world, command.steps, info.committed_steps);
  }
  const std::string flags = PinningFlags(options.spec, info.hierarchy.dims());
  if (!command.output.json) {
    PrintLine("pinned by: " + flags);
    if (options.animation) {
      PrintLine("view, fovea, rate and step follow the animation where it sets them");
    }
  }
  const StatusOr<exports::ExportReport> report = [&] {
    Progress progress(command.output, "export", "frames");
    return exports::Export(*provider, options, [&](const exports::ExportProgress& now) {
      progress.Update(now.done, now.total, now.now);
      return !Interrupted();
    });
  }();
  if (!report.ok()) {
    return report.status();
  }
  for (const std::string& note : report->notes) {
    Note(command.output, "note: " + note);
  }
  for (const frames::Warning& warning : report->warnings) {
    Warn(warning.message);
  }
  PrintReport(command, *report, flags, watch.ElapsedMs() / 1000);
  return absl::OkStatus();
}

}  // namespace fovea::cli
