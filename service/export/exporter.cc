#include "service/export/exporter.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>

#include <nlohmann/json.hpp>

#include "engine/fovea/retained_set.h"
#include "service/export/manifest.h"
#include "service/export/movie_writer.h"
#include "service/export/naming.h"
#include "service/export/picture_file.h"
#include "service/frames/frames.h"
#include "service/frames/spec_json.h"

namespace fovea::exports {
namespace {

constexpr size_t kMaxWarnings = 16;

using OnProgress = std::function<bool(const ExportProgress&)>;

StatusOr<std::vector<int64_t>> StepsOf(const ExportOptions& options, int64_t committed) {
  const int64_t last = options.last.value_or(committed - 1);
  for (const int64_t step : {options.first, last}) {
    if (step < 0 || step >= committed) {
      return OutOfRange("steps asked for include {}, which is not there: the dataset has 0 to {}",
                        step, committed - 1);
    }
  }
  std::vector<int64_t> steps;
  for (int64_t step = options.first; step <= last; step += options.stride) {
    steps.push_back(step);
  }
  return steps;
}

/// Equal exactly when the pictures would be: an animated frame depends on the steps asked for, a
/// plain one is named after its own.
std::string SettingsOf(const FrameProvider& provider, const ExportOptions& options,
                       const std::vector<PlannedFrame>& planned, double frames_per_second) {
  nlohmann::json settings = {{"fovea_export", 1},
                             {"dataset", provider.identity()},
                             {"spec", frames::SpecToJson(planned[0].spec)}};
  if (options.animation || IsMovie(options.output)) {
    settings["frames_per_second"] = frames_per_second;
    for (const PlannedFrame& frame : planned) {
      settings["steps"].push_back(frame.step);
    }
  }
  if (options.animation) {
    for (const PlannedFrame& frame : planned) {
      const nlohmann::json spec = frames::SpecToJson(frame.spec);
      settings["animation"].push_back({spec["view"], spec["fovea"], spec["rate"]});
    }
  }
  return settings.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

std::string ManifestStem(const std::string& output) {
  const StatusOr<FramePattern> pattern = FramePattern::Parse(output);
  if (IsMovie(output) || !pattern.ok()) {
    return output;
  }
  const std::filesystem::path path(output);
  return (path.parent_path() / (pattern->Stem() + path.extension().string())).string();
}

void AddFrame(const frames::Frame& frame, const ExportOptions& options, ExportReport* report) {
  frames::FrameStats& totals = report->totals;
  const frames::FrameStats& stats = frame.stats;
  totals.coefficients += stats.coefficients;
  totals.chunks_read += stats.chunks_read;
  totals.chunks_total += stats.chunks_total;
  totals.bytes_read += stats.bytes_read;
  totals.super_voxels += stats.super_voxels;
  totals.samples += stats.samples;
  totals.read_ms += stats.read_ms;
  totals.reconstruct_ms += stats.reconstruct_ms;
  totals.render_ms += stats.render_ms;
  totals.smooth_warp_ms += stats.smooth_warp_ms;
  totals.encode_ms += stats.encode_ms;
  ++report->frames_made;
  for (const frames::Warning& warning : frame.warnings) {
    if (options.on_warning) {
      options.on_warning(warning);
    }
    const bool known =
        std::any_of(report->warnings.begin(), report->warnings.end(),
                    [&](const frames::Warning& other) { return other.message == warning.message; });
    if (!known && report->warnings.size() < kMaxWarnings) {
      report->warnings.push_back(warning);
    }
  }
}

/// The end of the frames from `begin` on that a provider can be asked for at once: those of a shot
/// that follow each other, or all with one spec.
size_t RunEnd(const std::vector<PlannedFrame>& planned, size_t begin, bool of_shot) {
  size_t end = begin + 1;
  while (end < planned.size() && (of_shot ? planned[end].index == planned[end - 1].index + 1
                                          : planned[end].spec == planned[begin].spec)) {
    ++end;
  }
  return end;
}

/// Renders the planned frames in order, as many together as can be. One that cannot be rendered
/// is told to `on_failure`, if there is one, and left out; what `use` returns ends it all.
Status RenderPlanned(FrameProvider& provider, const std::vector<PlannedFrame>& planned,
                     const std::optional<Shot>& shot,
                     const std::function<Status(const PlannedFrame&, const frames::Frame&)>& use,
                     const std::function<void(const PlannedFrame&, const Status&)>& on_failure) {
  for (size_t next = 0; next < planned.size();) {
    const size_t end = RunEnd(planned, next, shot.has_value());
    Status used;
    const auto on_frame = [&](const frames::Frame& frame) {
      used = use(planned[next++], frame);
      return used;
    };
    std::vector<int64_t> steps;
    for (size_t i = next; i < end; ++i) {
      steps.push_back(planned[i].step);
    }
    const Status rendered =
        shot ? provider.RenderShot(*shot, planned[next].index, planned[end - 1].index + 1, on_frame)
             : provider.RenderEach(steps, planned[next].spec, on_frame);
    FOVEA_RETURN_IF_ERROR(used);
    if (!rendered.ok() && (on_failure == nullptr || next == end)) {
      return rendered;
    }
    if (!rendered.ok()) {
      on_failure(planned[next++], rendered);
    }
  }
  return absl::OkStatus();
}

Status Stopped(const ExportReport& report, const char* what_stays) {
  return Cancelled("stopped after {} of {} frames; {}", report.frames_made + report.frames_skipped,
                   report.frames_total, what_stays);
}

/// What an animation asks for is known before the first frame is rendered.
Status CheckPlanned(const store::DatasetInfo& info, const std::vector<PlannedFrame>& planned) {
  for (const PlannedFrame& frame : planned) {
    Status status = frames::ValidateSpec(frame.spec);
    if (status.ok()) {
      status = RetainedSet::Make(info.hierarchy, frames::FoveaOf(frame.spec)).status();
    }
    if (status.ok() && frame.spec.view.perspective) {
      frames::PerspectiveSpec camera = *frame.spec.view.perspective;
      status = frames::ResolveCamera(info, &camera);
    }
    if (!status.ok()) {
      return Annotate(status, fmt::format("frame {} of the animation", frame.index));
    }
  }
  return absl::OkStatus();
}

/// Splits off what is done. An error if a file is in the way that no export made.
StatusOr<std::vector<PlannedFrame>> NotDone(const std::vector<PlannedFrame>& planned,
                                            const Manifest& manifest, bool overwrite,
                                            ExportReport* report) {
  const Manifest::State state = manifest.Check();
  std::vector<PlannedFrame> todo;
  int64_t stale = 0;
  for (const PlannedFrame& frame : planned) {
    std::error_code error;
    const bool there = std::filesystem::exists(frame.path, error);
    if (there && state == Manifest::State::kNone && !overwrite) {
      return AlreadyExists(
          "{} exists and no export made it; --overwrite replaces it, or choose "
          "another name with -o",
          frame.path);
    }
    if (there && state == Manifest::State::kSame && !overwrite && manifest.IsDone(frame.path)) {
      ++report->frames_skipped;
      continue;
    }
    stale += there ? 1 : 0;
    todo.push_back(frame);
  }
  if (report->frames_skipped > 0) {
    report->notes.push_back(
        fmt::format("{} of {} frames were done already and are kept "
                    "(--overwrite makes them again)",
                    report->frames_skipped, report->frames_total));
  }
  if (stale > 0 && state == Manifest::State::kChanged && !overwrite) {
    report->notes.push_back(
        fmt::format("{} frames there were made with other settings and are made again", stale));
  }
  if (state != Manifest::State::kSame) {
    FOVEA_RETURN_IF_ERROR(manifest.Write());
  }
  return todo;
}

Status ExportPictures(FrameProvider& provider, const ExportOptions& options,
                      const std::vector<PlannedFrame>& planned, const std::optional<Shot>& shot,
                      const Manifest& manifest, const OnProgress& progress, ExportReport* report) {
  FOVEA_ASSIGN_OR_RETURN(const PictureFormat format, PictureFormatOf(options.output));
  std::vector<PlannedFrame> mine;
  for (const PlannedFrame& frame : planned) {
    if (frame.index % options.shard_count == options.shard_index) {
      mine.push_back(frame);
    }
  }
  report->frames_total = static_cast<int64_t>(mine.size());
  if (mine.empty()) {
    report->notes.push_back("this shard has no frames");
    return absl::OkStatus();
  }
  report->first_path = mine.front().path;
  report->last_path = mine.back().path;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<PlannedFrame> todo,
                         NotDone(mine, manifest, options.overwrite, report));
  return RenderPlanned(
      provider, todo, shot,
      [&](const PlannedFrame& planned_frame, const frames::Frame& frame) -> Status {
        FOVEA_RETURN_IF_ERROR(WritePicture(planned_frame.path, format, frame));
        AddFrame(frame, options, report);
        const int64_t done = report->frames_made + report->frames_skipped;
        const bool go_on = progress({done, report->frames_total, planned_frame.path});
        return go_on || done == report->frames_total
                   ? absl::OkStatus()
                   : Stopped(*report, "they stay; the same command goes on after them");
      },
      options.on_failure);
}

Status ExportMovie(FrameProvider& provider, const ExportOptions& options,
                   const std::vector<PlannedFrame>& planned, const std::optional<Shot>& shot,
                   const Manifest& manifest, const OnProgress& progress, ExportReport* report) {
  report->frames_total = static_cast<int64_t>(planned.size());
  report->first_path = options.output;
  report->last_path = options.output;
  PlannedFrame movie = planned[0];
  movie.path = options.output;
  FOVEA_ASSIGN_OR_RETURN(const auto todo, NotDone({movie}, manifest, options.overwrite, report));
  if (todo.empty()) {
    report->frames_skipped = report->frames_total;
    report->notes = {"the movie was done already and is kept (--overwrite makes it again)"};
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(
      const auto writer,
      MovieWriter::Open(options.output, static_cast<int>(*planned[0].spec.width_px),
                        static_cast<int>(*planned[0].spec.height_px), report->frames_per_second));
  const Status rendered = RenderPlanned(
      provider, planned, shot,
      [&](const PlannedFrame&, const frames::Frame& frame) -> Status {
        FOVEA_RETURN_IF_ERROR(writer->Write(frame.pixels));
        AddFrame(frame, options, report);
        const bool go_on = progress({report->frames_made, report->frames_total, options.output});
        return go_on || report->frames_made == report->frames_total
                   ? absl::OkStatus()
                   : Stopped(*report, "an unfinished movie is not kept");
      },
      nullptr);
  FOVEA_RETURN_IF_ERROR(rendered);
  return writer->Finish();
}

}  // namespace

Status CheckTools(const ExportOptions& options) {
  return IsMovie(options.output) ? MovieWriter::CheckEncoder(options.output) : absl::OkStatus();
}

StatusOr<ExportReport> Export(FrameProvider& provider, const ExportOptions& options,
                              const OnProgress& progress) {
  FOVEA_RETURN_IF_ERROR(ValidateExport(options));
  const bool movie = IsMovie(options.output);
  frames::FrameSpec wanted = options.spec;
  wanted.encoding = frames::Encoding::kRawRgba8;
  FOVEA_RETURN_IF_ERROR(CheckTools(options));
  if (!movie) {
    FOVEA_ASSIGN_OR_RETURN(const PictureFormat format, PictureFormatOf(options.output));
    wanted.encoding = EncodingFor(format);
  }
  const int64_t committed = provider.info().committed_steps;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<int64_t> range, StepsOf(options, committed));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<StepInfo> steps, provider.Describe(range));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec spec, provider.Resolve(wanted));
  FOVEA_ASSIGN_OR_RETURN(const auto planned, PlanFrames(options, steps, committed, spec));

  FOVEA_RETURN_IF_ERROR(CheckPlanned(provider.info(), planned));

  std::optional<Shot> shot;
  if (options.animation) {
    shot.emplace(Shot{*options.animation, spec, range.front(), range.back(), options.stride});
  }
  ExportReport report;
  report.frames_per_second =
      options.frames_per_second.value_or(options.animation ? 24 : NaturalFrameRate(steps));
  const Manifest manifest(ManifestStem(options.output),
                          SettingsOf(provider, options, planned, report.frames_per_second));
  FOVEA_RETURN_IF_ERROR(
      movie ? ExportMovie(provider, options, planned, shot, manifest, progress, &report)
            : ExportPictures(provider, options, planned, shot, manifest, progress, &report));
  return report;
}

}  // namespace fovea::exports
