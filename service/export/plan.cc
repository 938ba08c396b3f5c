#include <cmath>
#include <set>

#include "service/export/exporter.h"
#include "service/export/movie_writer.h"
#include "service/export/naming.h"
#include "service/export/picture_file.h"

namespace fovea::exports {
namespace {

/// The number in a step's file name: what its source called it, or the step.
int64_t NumberOf(const StepInfo& step) {
  return step.frame_number.value_or(step.step);
}

/// Frame numbers name files only if no two steps share one.
bool NumbersAreDistinct(const std::vector<StepInfo>& steps) {
  std::set<int64_t> seen;
  for (const StepInfo& step : steps) {
    if (!seen.insert(NumberOf(step)).second) {
      return false;
    }
  }
  return true;
}

StatusOr<std::vector<PlannedFrame>> PlanAnimation(const frames::Animation& animation,
                                                  const std::vector<StepInfo>& steps,
                                                  int64_t committed_steps,
                                                  const frames::FrameSpec& spec) {
  std::vector<PlannedFrame> planned;
  const auto count = static_cast<int64_t>(steps.size());
  for (int64_t frame = 0; frame < animation.frames(); ++frame) {
    const auto place = static_cast<size_t>(animation.PlaceIn(count, frame));
    const int64_t step = animation.StepAt(frame).value_or(steps[place].step);
    if (step >= committed_steps) {
      return OutOfRange(
          "step {} of the animation's frame {} is not there: the dataset has steps 0 "
          "to {}",
          step, frame, committed_steps - 1);
    }
    planned.push_back({frame, step, animation.SpecAt(frame, spec), ""});
  }
  return planned;
}

}  // namespace

Status ValidateOutputName(const std::string& output) {
  if (IsMovie(output)) {
    return absl::OkStatus();
  }
  if (!PictureFormatOf(output).ok()) {
    return InvalidArgument(
        "'{}' ends in no format that can be written: pictures .png .jpg .exr .tif .npy .fvf, "
        "movies "
        ".mp4 .mov .webm",
        output);
  }
  return FramePattern::Parse(output).status();
}

Status ValidateExport(const ExportOptions& options) {
  const bool movie = IsMovie(options.output);
  FOVEA_RETURN_IF_ERROR(ValidateOutputName(options.output));
  if (!movie) {
    FOVEA_ASSIGN_OR_RETURN(const PictureFormat format, PictureFormatOf(options.output));
    if (options.spec.fovea_marker && EncodingFor(format) == frames::Encoding::kRawRgbaF32) {
      return InvalidArgument(
          "fovea_marker: the red dot is drawn in .png, .jpg and movies only, not "
          "in linear pictures such as '{}'",
          options.output);
    }
  }
  if (movie && options.shard_count > 1) {
    return InvalidArgument(
        "shard {}/{}: a movie cannot be made in parts; export numbered pictures "
        "(f.####.png) in shards, then encode them",
        options.shard_index, options.shard_count);
  }
  if (options.frames_per_second &&
      !(*options.frames_per_second >= 0.01 && *options.frames_per_second <= 1000)) {
    return InvalidArgument("fps {} is outside its range, 0.01 to 1000", *options.frames_per_second);
  }
  return absl::OkStatus();
}

StatusOr<std::vector<PlannedFrame>> PlanFrames(const ExportOptions& options,
                                               const std::vector<StepInfo>& steps,
                                               int64_t committed_steps,
                                               const frames::FrameSpec& spec) {
  std::vector<PlannedFrame> planned;
  if (options.animation) {
    FOVEA_ASSIGN_OR_RETURN(planned,
                           PlanAnimation(*options.animation, steps, committed_steps, spec));
  } else {
    for (const StepInfo& step : steps) {
      planned.push_back({static_cast<int64_t>(planned.size()), step.step, spec, ""});
    }
  }
  if (IsMovie(options.output)) {
    return planned;
  }
  FOVEA_ASSIGN_OR_RETURN(const FramePattern pattern, FramePattern::Parse(options.output));
  const bool by_number = !options.animation && NumbersAreDistinct(steps);
  for (PlannedFrame& frame : planned) {
    const int64_t number = options.animation ? frame.index
                           : by_number       ? NumberOf(steps[static_cast<size_t>(frame.index)])
                                             : frame.step;
    frame.path = pattern.PathOf(number);
  }
  return planned;
}

double NaturalFrameRate(const std::vector<StepInfo>& steps) {
  constexpr double kUsual = 24;
  if (steps.size() < 2) {
    return kUsual;
  }
  const auto span_ns = static_cast<double>(steps.back().time_ns - steps.front().time_ns);
  const double gap_ns = span_ns / static_cast<double>(steps.size() - 1);
  for (size_t i = 1; i < steps.size(); ++i) {
    const auto gap = static_cast<double>(steps[i].time_ns - steps[i - 1].time_ns);
    if (std::abs(gap - gap_ns) > 0.001 * gap_ns + 1) {
      return kUsual;
    }
  }
  const double rate = std::round(1e12 / gap_ns) / 1000;
  return rate >= 1 && rate <= 240 ? rate : kUsual;
}

}  // namespace fovea::exports
