#include "service/wire/status.h"

#include <algorithm>
#include <array>
#include <utility>

#include <google/protobuf/any.pb.h>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "service/wire/printable.h"

namespace fovea::wire {
namespace {

constexpr char kBadRequestType[] = "type.googleapis.com/google.rpc.BadRequest";
constexpr char kResourceType[] = "type.googleapis.com/google.rpc.ResourceInfo";
constexpr char kQuotaType[] = "type.googleapis.com/google.rpc.QuotaFailure";
constexpr char kRetryType[] = "type.googleapis.com/google.rpc.RetryInfo";
/// The details that pass through: others are dropped, on both sides.
constexpr std::array<absl::string_view, 4> kDetailTypes = {kBadRequestType, kResourceType,
                                                           kQuotaType, kRetryType};
/// A delay from outside that is longer is read as this long.
constexpr int64_t kMaxRetrySeconds = int64_t{366} * 86'400;
/// Message and details must together fit the 8 KiB that clients allow for metadata by default,
/// percent-encoded the one, in base64 the other.
constexpr size_t kMaxMessageBytes = 1000;
constexpr size_t kMaxDescriptionBytes = 500;

/// Fields of a FrameSpec that are not at its top level.
constexpr std::array<std::pair<std::string_view, std::string_view>, 11> kNestedFields{{
    {"azimuth_deg", "view.orthographic.azimuth_deg"},
    {"elevation_deg", "view.orthographic.elevation_deg"},
    {"center", "view.orthographic.center"},
    {"span_voxels", "view.orthographic.span_voxels"},
    {"eye", "view.perspective.eye"},
    {"target", "view.perspective.target"},
    {"up", "view.perspective.up"},
    {"fov_y_deg", "view.perspective.fov_y_deg"},
    {"falloff_per_voxel", "weighting.falloff_per_voxel"},
    {"clip_box", "clip.box"},
    {"clip_plane", "clip.planes"},
}};

Status WithDetails(Status status, std::string_view path, std::string_view description) {
  google::rpc::BadRequest details;
  auto* violation = details.add_field_violations();
  violation->set_field(path.data(), path.size());
  violation->set_description(Printable(description, kMaxDescriptionBytes));
  status.SetPayload(kBadRequestType, absl::Cord(details.SerializeAsString()));
  return status;
}

/// The details of one type; empty if there are none, or they cannot be read.
template <typename Message>
std::optional<Message> DetailsOf(const Status& status, const char* type) {
  Message details;
  const auto payload = status.GetPayload(type);
  if (!payload.has_value() || !details.ParseFromString(std::string(*payload))) {
    return std::nullopt;
  }
  return details;
}

void Attach(Status* status, const char* type, const google::protobuf::Message& details) {
  status->SetPayload(type, absl::Cord(details.SerializeAsString()));
}

}  // namespace

Status BadField(std::string_view path, std::string_view description) {
  return WithDetails(InvalidArgument("{}: {}", path, description), path, description);
}

Status PointAtSpecField(const Status& status, std::string_view path) {
  if (status.code() != absl::StatusCode::kInvalidArgument || !FieldOf(status).empty()) {
    return status;
  }
  const std::string_view message = MessageOf(status);
  const size_t end = message.find_first_not_of("abcdefghijklmnopqrstuvwxyz_");
  const std::string_view name = message.substr(0, end);
  std::string_view below = name;
  for (const auto& [leaf, nested] : kNestedFields) {
    below = leaf == name ? nested : below;
  }
  return WithDetails(status, fmt::format("{}.{}", path, below), message);
}

std::string FieldOf(const Status& status) {
  const auto details = DetailsOf<google::rpc::BadRequest>(status, kBadRequestType);
  return details && !details->field_violations().empty() ? details->field_violations(0).field()
                                                         : "";
}

Status WithResource(Status status, std::string_view type, std::string_view name) {
  google::rpc::ResourceInfo details;
  details.set_resource_type(type.data(), type.size());
  details.set_resource_name(Printable(name, kMaxDescriptionBytes));
  Attach(&status, kResourceType, details);
  return status;
}

Status WithQuota(Status status, std::string_view subject, std::string_view description) {
  google::rpc::QuotaFailure details;
  auto* violation = details.add_violations();
  violation->set_subject(subject.data(), subject.size());
  violation->set_description(Printable(description, kMaxDescriptionBytes));
  Attach(&status, kQuotaType, details);
  return status;
}

Status WithRetry(Status status, std::chrono::milliseconds delay) {
  google::rpc::RetryInfo details;
  const auto seconds = std::chrono::floor<std::chrono::seconds>(delay);
  details.mutable_retry_delay()->set_seconds(seconds.count());
  details.mutable_retry_delay()->set_nanos(
      static_cast<int32_t>(std::chrono::nanoseconds(delay - seconds).count()));
  Attach(&status, kRetryType, details);
  return status;
}

std::optional<std::chrono::milliseconds> RetryDelayOf(const Status& status) {
  const auto details = DetailsOf<google::rpc::RetryInfo>(status, kRetryType);
  if (!details) {
    return std::nullopt;
  }
  const auto& delay = details->retry_delay();
  return std::chrono::seconds(std::clamp<int64_t>(delay.seconds(), 0, kMaxRetrySeconds)) +
         std::chrono::milliseconds(std::clamp(delay.nanos(), 0, 999'999'999) / 1'000'000);
}

bool HasQuota(const Status& status) {
  return status.GetPayload(kQuotaType).has_value();
}

std::string DescribeDetails(const Status& status) {
  std::string text;
  if (const auto quota = DetailsOf<google::rpc::QuotaFailure>(status, kQuotaType)) {
    for (const auto& violation : quota->violations()) {
      text += fmt::format("; quota of {}: {}", Printable(violation.subject()),
                          Printable(violation.description(), kMaxDescriptionBytes));
    }
  }
  if (const auto delay = RetryDelayOf(status)) {
    text += fmt::format("; try again in {:.3g} s", std::chrono::duration<double>(*delay).count());
  }
  return text;
}

Status WithMessage(const Status& status, std::string_view message) {
  Status result = MakeStatus(status.code(), message);
  status.ForEachPayload(
      [&](absl::string_view type, const absl::Cord& payload) { result.SetPayload(type, payload); });
  return result;
}

grpc::Status ToGrpc(const Status& status) {
  if (status.ok()) {
    return grpc::Status::OK;
  }
  const auto code = static_cast<grpc::StatusCode>(status.code());
  const std::string message = Printable(MessageOf(status), kMaxMessageBytes);
  google::rpc::Status details;
  for (const absl::string_view type : kDetailTypes) {
    if (const auto payload = status.GetPayload(type)) {
      auto* packed = details.add_details();
      packed->set_type_url(type.data(), type.size());
      packed->set_value(std::string(*payload));
    }
  }
  if (details.details().empty()) {
    return {code, message};
  }
  details.set_code(static_cast<int>(code));
  details.set_message(message);
  return {code, message, details.SerializeAsString()};
}

Status FromGrpc(const grpc::Status& status) {
  if (status.ok()) {
    return absl::OkStatus();
  }
  Status result =
      MakeStatus(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
  google::rpc::Status details;
  if (details.ParseFromString(status.error_details())) {
    for (const auto& packed : details.details()) {
      const auto known =
          std::find(kDetailTypes.begin(), kDetailTypes.end(), absl::string_view(packed.type_url()));
      if (known != kDetailTypes.end()) {
        result.SetPayload(*known, absl::Cord(packed.value()));
      }
    }
  }
  return result;
}

}  // namespace fovea::wire
