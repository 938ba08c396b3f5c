#ifndef SERVICE_WIRE_REQUESTS_H_
#define SERVICE_WIRE_REQUESTS_H_

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "fovea/v1/datasets.pb.h"
#include "fovea/v1/render.pb.h"
#include "service/frames/animation.h"
#include "service/frames/plan.h"
#include "service/frames/spec.h"

/// Requests as plain structs, checked: what can be told without looking at a dataset has been. All
/// errors are INVALID_ARGUMENT and point at the field. Thread-safe.
namespace fovea::wire {

inline constexpr uint32_t kMaxWindow = 64;
inline constexpr uint32_t kMaxPageSize = 1000;
inline constexpr uint32_t kDefaultPageSize = 100;

struct FrameRequest {
  std::string dataset;
  uint64_t step = 0;
  std::optional<int64_t> time_ns;  // instead of the step
  frames::FrameSpec spec;
};

/// What an Animation is made of once the number of steps is known.
struct PathRequest {
  std::optional<int64_t> frames;  // default: one a step
  std::vector<frames::Keyframe> keys;
};

struct SequenceRequest {
  std::string dataset;
  uint64_t first = 0;
  std::optional<uint64_t> last;  // included; not below `first`
  uint64_t stride = 1;           // at least 1
  frames::FrameSpec spec;
  uint64_t start_index = 0;
  uint32_t window = 0;    // 0: no acknowledgements
  std::string stream_id;  // may be empty if window is 0
  bool follow = false;    // new steps after the range; never with `last`
  bool newest = false;    // the range is the last step alone, instead of from `first` on
  std::optional<PathRequest> path;
};

struct PlanRequest {
  FrameRequest frame;
  frames::FrameBudget budget;
};

struct HistogramRequest {
  std::string dataset;
  uint64_t step = 0;
  std::optional<int64_t> time_ns;    // instead of the step
  std::optional<std::string> field;  // default: the default field
};

struct ListRequest {
  uint32_t page_size = kDefaultPageSize;
  std::string after;  // names up to this one have been listed
};

struct WatchRequest {
  std::string dataset;
  uint64_t first_step = 0;
  bool wait = false;  // for a dataset that is not there
};

[[nodiscard]] StatusOr<FrameRequest> FromProto(const v1::RenderFrameRequest& proto);
[[nodiscard]] StatusOr<SequenceRequest> FromProto(const v1::RenderSequenceRequest& proto);
[[nodiscard]] StatusOr<PlanRequest> FromProto(const v1::PlanFrameRequest& proto);
[[nodiscard]] StatusOr<HistogramRequest> FromProto(const v1::GetHistogramRequest& proto);
[[nodiscard]] StatusOr<ListRequest> FromProto(const v1::ListDatasetsRequest& proto);
[[nodiscard]] StatusOr<WatchRequest> FromProto(const v1::WatchDatasetRequest& proto);

/// The part of FromProto that every request with a dataset shares; GetDataset has nothing else.
[[nodiscard]] Status CheckDatasetName(const std::string& name);

/// The page_token that continues after the dataset `name`.
[[nodiscard]] std::string PageTokenAfter(const std::string& name);

/// The steps of a sequence, once the number of committed steps is known.
struct StepSeries {
  int64_t first = 0;
  int64_t stride = 1;
  int64_t count = 0;
  /// The frames that there are of it when this many steps are committed, if it has no end.
  [[nodiscard]] int64_t CountAt(int64_t committed_steps) const {
    return std::max(count, (committed_steps - 1 - first) / stride + 1);
  }
  [[nodiscard]] int64_t StepAt(int64_t index) const { return first + index * stride; }
};

/// OUT_OF_RANGE for a step that is not committed; INVALID_ARGUMENT for a start_index past the end
/// of what has no path.
[[nodiscard]] StatusOr<StepSeries> ResolveSteps(const SequenceRequest& request,
                                                int64_t committed_steps);
/// The path of a request that has one, over the steps of `series`. OUT_OF_RANGE for a keyframe with
/// a step that is not committed; INVALID_ARGUMENT for keyframes or a start_index past its end.
[[nodiscard]] StatusOr<frames::Animation> ResolvePath(const SequenceRequest& request,
                                                      const StepSeries& series,
                                                      int64_t committed_steps);
/// An error of the frame at a keyframe: if it is about what keyframes say, it points at the one
/// that does.
[[nodiscard]] Status PointAtKeyframe(const Status& status, const frames::Animation& path,
                                     size_t key);
[[nodiscard]] v1::Path ToProto(const frames::Animation& animation);

/// OUT_OF_RANGE, saying which steps there are, unless `step` is below `committed_steps`.
[[nodiscard]] Status CheckStep(const std::string& dataset, uint64_t step, int64_t committed_steps);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_REQUESTS_H_
