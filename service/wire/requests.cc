#include "service/wire/requests.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "service/wire/convert.h"
#include "service/wire/path.h"
#include "service/wire/printable.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr std::string_view kPageTokenPrefix = "after:";

bool IsStreamIdCharacter(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' ||
         c == '-';
}

Status CheckPacing(const v1::RenderSequenceRequest& proto) {
  if (proto.window() > kMaxWindow) {
    return BadField("window", fmt::format("{} is outside 0 to {}", proto.window(), kMaxWindow));
  }
  const std::string& id = proto.stream_id();
  if (id.empty() && proto.window() == 0) {
    return absl::OkStatus();
  }
  if (id.size() < 16 || id.size() > 64 || !std::all_of(id.begin(), id.end(), IsStreamIdCharacter)) {
    return BadField("stream_id",
                    fmt::format("'{}' is not 16 to 64 of A-Z a-z 0-9 _ -; a window above 0 needs a "
                                "random one, to acknowledge by",
                                Printable(id)));
  }
  return absl::OkStatus();
}

Status TakeLimit(std::string_view field, bool is_given, uint64_t value,
                 std::optional<uint64_t>* limit) {
  if (is_given && value == 0) {
    return BadField(field, "0 is outside its range, from 1");
  }
  if (is_given) {
    *limit = value;
  }
  return absl::OkStatus();
}

Status CheckStart(uint64_t start_index, int64_t frames) {
  return start_index <= static_cast<uint64_t>(frames)
             ? absl::OkStatus()
             : BadField("start_index", fmt::format("{} is outside 0 to {}, the frames of the range",
                                                   start_index, frames));
}

}  // namespace

Status CheckDatasetName(const std::string& name) {
  if (name.empty()) {
    return BadField("dataset", "is empty; ListDatasets says which there are");
  }
  return absl::OkStatus();
}

StatusOr<FrameRequest> FromProto(const v1::RenderFrameRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  FrameRequest request;
  request.dataset = proto.dataset();
  request.step = proto.step();
  if (proto.has_time_ns()) {
    request.time_ns = proto.time_ns();
  }
  FOVEA_ASSIGN_OR_RETURN(request.spec, FromProto(proto.spec(), "spec"));
  return request;
}

StatusOr<SequenceRequest> FromProto(const v1::RenderSequenceRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  FOVEA_RETURN_IF_ERROR(CheckPacing(proto));
  const v1::StepRange& steps = proto.steps();
  if (steps.has_stride() && steps.stride() == 0) {
    return BadField("steps.stride", "0 is outside its range, from 1");
  }
  if (steps.has_last() && steps.last() < steps.first()) {
    return BadField("steps.last",
                    fmt::format("{} is before steps.first, {}", steps.last(), steps.first()));
  }
  if (proto.follow() && steps.has_last()) {
    return BadField("steps.last", "does not go with follow, which has no end");
  }
  SequenceRequest request;
  request.dataset = proto.dataset();
  request.follow = proto.follow();
  request.newest = proto.follow() && !proto.has_steps();
  request.first = steps.first();
  if (steps.has_last()) {
    request.last = steps.last();
  }
  request.stride = steps.has_stride() ? steps.stride() : 1;
  FOVEA_ASSIGN_OR_RETURN(request.spec, FromProto(proto.spec(), "spec"));
  request.start_index = proto.start_index();
  request.window = proto.window();
  request.stream_id = proto.stream_id();
  if (proto.has_path()) {
    if (proto.follow()) {
      return BadField("path", "does not go with follow, which has no end");
    }
    FOVEA_ASSIGN_OR_RETURN(request.path, FromProto(proto.path(), "path"));
  }
  return request;
}

StatusOr<PlanRequest> FromProto(const v1::PlanFrameRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  PlanRequest request;
  request.frame.dataset = proto.dataset();
  request.frame.step = proto.step();
  if (proto.has_time_ns()) {
    request.frame.time_ns = proto.time_ns();
  }
  FOVEA_ASSIGN_OR_RETURN(request.frame.spec, FromProto(proto.spec(), "spec"));
  const v1::FrameBudget& budget = proto.budget();
  if (budget.has_total_ms()) {
    if (!(budget.total_ms() > 0) || !std::isfinite(budget.total_ms())) {
      return BadField("budget.total_ms",
                      fmt::format("{} is not finite and above 0", budget.total_ms()));
    }
    request.budget.ms = budget.total_ms();
  }
  FOVEA_RETURN_IF_ERROR(TakeLimit("budget.memory_bytes", budget.has_memory_bytes(),
                                  budget.memory_bytes(), &request.budget.memory_bytes));
  FOVEA_RETURN_IF_ERROR(TakeLimit("budget.bytes_read", budget.has_bytes_read(), budget.bytes_read(),
                                  &request.budget.bytes_read));
  FOVEA_RETURN_IF_ERROR(TakeLimit("budget.coefficients", budget.has_coefficients(),
                                  budget.coefficients(), &request.budget.coefficients));
  return request;
}

StatusOr<HistogramRequest> FromProto(const v1::GetHistogramRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  HistogramRequest request;
  request.dataset = proto.dataset();
  request.step = proto.step();
  if (proto.has_time_ns()) {
    request.time_ns = proto.time_ns();
  }
  if (proto.has_field()) {
    request.field = proto.field();
  }
  return request;
}

StatusOr<ListRequest> FromProto(const v1::ListDatasetsRequest& proto) {
  ListRequest request;
  if (proto.page_size() > kMaxPageSize) {
    return BadField("page_size",
                    fmt::format("{} is outside 0 to {}", proto.page_size(), kMaxPageSize));
  }
  request.page_size = proto.page_size() == 0 ? kDefaultPageSize : proto.page_size();
  if (!proto.page_token().empty()) {
    if (!proto.page_token().starts_with(kPageTokenPrefix)) {
      return BadField("page_token", fmt::format("'{}' is no next_page_token of this server",
                                                Printable(proto.page_token())));
    }
    request.after = proto.page_token().substr(kPageTokenPrefix.size());
  }
  return request;
}

StatusOr<WatchRequest> FromProto(const v1::WatchDatasetRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  return WatchRequest{proto.dataset(), proto.first_step(), proto.wait()};
}

std::string PageTokenAfter(const std::string& name) {
  return std::string(kPageTokenPrefix) + name;
}

Status CheckStep(const std::string& dataset, uint64_t step, int64_t committed_steps) {
  if (committed_steps == 0) {
    return OutOfRange("step {} is not there: dataset '{}' has no committed step yet", step,
                      dataset);
  }
  if (step >= static_cast<uint64_t>(committed_steps)) {
    return OutOfRange("step {} is not there: dataset '{}' has steps 0 to {}", step, dataset,
                      committed_steps - 1);
  }
  return absl::OkStatus();
}

StatusOr<StepSeries> ResolveSteps(const SequenceRequest& request, int64_t committed_steps) {
  FOVEA_RETURN_IF_ERROR(
      Annotate(CheckStep(request.dataset, request.first, committed_steps), "steps.first"));
  const uint64_t first =
      request.newest ? static_cast<uint64_t>(committed_steps) - 1 : request.first;
  const uint64_t last = request.last.value_or(static_cast<uint64_t>(committed_steps) - 1);
  FOVEA_RETURN_IF_ERROR(Annotate(CheckStep(request.dataset, last, committed_steps), "steps.last"));
  StepSeries series;
  series.first = static_cast<int64_t>(first);
  // Past the end of any series; cut before the cast.
  constexpr uint64_t kLongestStride = uint64_t{1} << 40;
  series.stride = static_cast<int64_t>(std::min(request.stride, kLongestStride));
  series.count = (static_cast<int64_t>(last) - series.first) / series.stride + 1;
  if (!request.path) {
    FOVEA_RETURN_IF_ERROR(CheckStart(request.start_index, series.count));
  }
  return series;
}

StatusOr<frames::Animation> ResolvePath(const SequenceRequest& request, const StepSeries& series,
                                        int64_t committed_steps) {
  const PathRequest& path = *request.path;
  const int64_t count = path.frames.value_or(series.count);
  for (size_t i = 0; i < path.keys.size(); ++i) {
    const frames::Keyframe& key = path.keys[i];
    if (key.frame > count) {
      return BadField(fmt::format("path.keys[{}].frame", i),
                      fmt::format("{} is outside 0 to {}, the frames", key.frame, count));
    }
    if (key.step) {
      FOVEA_RETURN_IF_ERROR(
          Annotate(CheckStep(request.dataset, static_cast<uint64_t>(*key.step), committed_steps),
                   fmt::format("path.keys[{}].step", i)));
    }
  }
  FOVEA_RETURN_IF_ERROR(CheckStart(request.start_index, count));
  auto animation = frames::Animation::Make(count, path.keys);
  return animation.ok() ? std::move(animation) : BadField("path", MessageOf(animation.status()));
}

}  // namespace fovea::wire
