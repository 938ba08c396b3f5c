#include "service/wire/view_request.h"

#include <vector>

#include <google/protobuf/message.h>

#include "service/wire/convert.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr double kDefaultFirstFrameMs = 15;
constexpr double kDefaultFrameBudgetMs = 30;
constexpr double kLeastMs = 1, kMostMs = 10'000;

StatusOr<double> CheckMs(const char* field, double ms) {
  if (!(ms >= kLeastMs && ms <= kMostMs)) {
    return BadField(field,
                    fmt::format("{} is outside {} to {} milliseconds", ms, kLeastMs, kMostMs));
  }
  return ms;
}

/// Puts what `change` holds in the place of what `spec` has.
void Replace(const v1::FrameSpec& change, v1::FrameSpec* spec) {
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  change.GetReflection()->ListFields(change, &fields);
  for (const auto* field : fields) {
    spec->GetReflection()->ClearField(spec, field);
  }
  if (change.has_rate()) {  // the two are one setting
    spec->clear_rate_xyz();
  } else if (change.has_rate_xyz()) {
    spec->clear_rate();
  }
  spec->MergeFrom(change);
  spec->DiscardUnknownFields();  // they would gather, request by request
}

bool IsAcknowledgementOnly(v1::ExploreRequest proto) {
  if (!proto.has_acknowledged()) {
    return false;
  }
  proto.clear_acknowledged();
  return proto.ByteSizeLong() == 0;
}

template <typename Proto>
void TakeWhen(const Proto& proto, ViewRequest* request) {
  request->step = proto.step();
  if (proto.has_time_ns()) {
    request->time_ns = proto.time_ns();
  }
}

}  // namespace

StatusOr<ViewRequest> FromProto(const v1::RefineFrameRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  ViewRequest request;
  request.dataset = proto.dataset();
  TakeWhen(proto, &request);
  FOVEA_ASSIGN_OR_RETURN(request.spec, FromProto(proto.spec(), "spec"));
  FOVEA_ASSIGN_OR_RETURN(request.budget_ms, CheckMs("first_frame_ms", proto.has_first_frame_ms()
                                                                          ? proto.first_frame_ms()
                                                                          : kDefaultFirstFrameMs));
  return request;
}

StatusOr<ExploreRequests::Change> ExploreRequests::Add(const v1::ExploreRequest& proto) {
  Change change;
  if (proto.has_acknowledged()) {
    change.acknowledged = proto.acknowledged();
  }
  if (proto.has_window()) {
    if (proto.window() > kMaxWindow) {
      return BadField("window", fmt::format("{} is outside 0 to {}", proto.window(), kMaxWindow));
    }
    change.window = proto.window();
  }
  if (IsAcknowledgementOnly(proto)) {
    return change;
  }
  dataset_ = proto.dataset().empty() ? dataset_ : proto.dataset();
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(dataset_));
  if (proto.when_case() != v1::ExploreRequest::WHEN_NOT_SET) {
    when_ = proto;
    when_.clear_spec();
    when_.DiscardUnknownFields();
  }
  if (proto.reset_spec()) {
    spec_.Clear();
  }
  Replace(proto.spec(), &spec_);
  if (proto.has_frame_budget_ms()) {
    FOVEA_ASSIGN_OR_RETURN(budget_ms_, CheckMs("frame_budget_ms", proto.frame_budget_ms()));
  }
  ViewRequest& view = change.view.emplace();
  view.dataset = dataset_;
  TakeWhen(when_, &view);
  view.latest = when_.latest();
  FOVEA_ASSIGN_OR_RETURN(view.spec, FromProto(spec_, "spec"));
  view.view_id = proto.view_id();
  view.moving = proto.moving();
  view.budget_ms = budget_ms_.value_or(kDefaultFrameBudgetMs);
  return change;
}

}  // namespace fovea::wire
