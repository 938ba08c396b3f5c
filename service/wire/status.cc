#include "service/wire/status.h"

#include <array>
#include <utility>

#include <google/protobuf/any.pb.h>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"

namespace fovea::wire {
namespace {

constexpr char kBadRequestType[] = "type.googleapis.com/google.rpc.BadRequest";
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
  google::rpc::BadRequest details;
  const auto payload = status.GetPayload(kBadRequestType);
  if (!payload.has_value() || !details.ParseFromString(std::string(*payload)) ||
      details.field_violations().empty()) {
    return "";
  }
  return details.field_violations(0).field();
}

grpc::Status ToGrpc(const Status& status) {
  if (status.ok()) {
    return grpc::Status::OK;
  }
  const auto code = static_cast<grpc::StatusCode>(status.code());
  const std::string message = Printable(MessageOf(status), kMaxMessageBytes);
  const auto payload = status.GetPayload(kBadRequestType);
  if (!payload.has_value()) {
    return {code, message};
  }
  google::rpc::Status details;
  details.set_code(static_cast<int>(code));
  details.set_message(message);
  auto* packed = details.add_details();
  packed->set_type_url(kBadRequestType);
  packed->set_value(std::string(*payload));
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
      if (packed.type_url() == kBadRequestType) {
        result.SetPayload(kBadRequestType, absl::Cord(packed.value()));
      }
    }
  }
  return result;
}

std::string Printable(std::string_view text, size_t max_bytes) {
  const auto continues = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) == 0x80U; };
  std::string result;
  for (const char c : text) {
    if (result.size() >= max_bytes && !continues(c)) {  // never in the middle of a character
      return result + "...";
    }
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7F) {
      result += fmt::format("\\x{:02x}", byte);
    } else {
      result += c;
    }
  }
  return result;
}

}  // namespace fovea::wire
