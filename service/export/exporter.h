#ifndef SERVICE_EXPORT_EXPORTER_H_
#define SERVICE_EXPORT_EXPORTER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/export/frame_provider.h"
#include "service/frames/animation.h"
#include "service/frames/spec.h"

/// A sequence of frames as numbered pictures or as a movie.
namespace fovea::exports {

/// One frame of an export: its place in the sequence, what it shows, and (pictures) its file.
struct PlannedFrame {
  int64_t index = 0;
  int64_t step = 0;
  frames::FrameSpec spec;
  std::string path;  // empty: a frame of a movie
};

struct ExportOptions {
  std::string output;  // 'f.####.png' and its like, or a movie's name
  int64_t first = 0;
  std::optional<int64_t> last;  // included; absent: the last committed step
  int64_t stride = 1;
  frames::FrameSpec spec;
  std::optional<frames::Animation> animation;  // frames of its own, over the steps above
  std::optional<double> frames_per_second;     // movies; absent: from the times of the steps, or 24
  int64_t shard_index = 0, shard_count = 1;    // only frames with index % count == this; pictures
  bool overwrite = false;
  /// Called for a picture that could not be rendered, which is then left out; empty: it ends the
  /// export. Not for movies, nor for files that cannot be written.
  std::function<void(const PlannedFrame&, const Status&)> on_failure;
  /// Called for each warning of each frame made, as it is made; may be empty.
  std::function<void(const frames::Warning&)> on_warning;
};

struct ExportReport {
  int64_t frames_total = 0;  // of this shard
  int64_t frames_made = 0;
  int64_t frames_skipped = 0;  // were done already
  std::string first_path, last_path;
  double frames_per_second = 0;           // movies
  frames::FrameSpec spec;                 // of the first frame, nothing left to default
  frames::FrameStats totals;              // summed over the frames made
  std::vector<std::string> notes;         // what was decided for the user, one line each
  std::vector<frames::Warning> warnings;  // of the frames, each once, at most 16
};

struct ExportProgress {
  int64_t done = 0, total = 0;  // skipped frames count as done, failed ones do not
  std::string now;              // the file in hand
};

/// INVALID_ARGUMENT for a name that is no movie's, nor that of numbered pictures.
[[nodiscard]] Status ValidateOutputName(const std::string& output);

/// INVALID_ARGUMENT for options that cannot be meant, told without touching the dataset: a name
/// without a number's place, shards of a movie, a fovea marker in linear pictures ...
[[nodiscard]] Status ValidateExport(const ExportOptions& options);

/// What can be checked before there is a dataset: a movie needs ffmpeg and its encoder (NOT_FOUND).
[[nodiscard]] Status CheckTools(const ExportOptions& options);

/// Everything in order; see ExportOptions. Frames that are done already are skipped (manifest.h).
/// ALREADY_EXISTS if a file is in the way that no export made. `progress` returns false to stop
/// after the frame in hand (CANCELLED): finished pictures stay, an unfinished movie does not.
[[nodiscard]] StatusOr<ExportReport> Export(
    FrameProvider& provider, const ExportOptions& options,
    const std::function<bool(const ExportProgress&)>& progress);

/// The frames of the whole export, before it is cut into shards. `steps` are those of the range,
/// in order, at least one; `spec` is resolved. OUT_OF_RANGE if the animation shows another step.
[[nodiscard]] StatusOr<std::vector<PlannedFrame>> PlanFrames(const ExportOptions& options,
                                                             const std::vector<StepInfo>& steps,
                                                             int64_t committed_steps,
                                                             const frames::FrameSpec& spec);

/// Frames a second at which these steps play in real time, if they are equally far apart in time;
/// else 24.
[[nodiscard]] double NaturalFrameRate(const std::vector<StepInfo>& steps);

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_EXPORTER_H_
