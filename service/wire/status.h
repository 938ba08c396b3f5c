#ifndef SERVICE_WIRE_STATUS_H_
#define SERVICE_WIRE_STATUS_H_

#include <chrono>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include <grpcpp/support/status.h>

#include "engine/base/status.h"

/// Errors on their way through gRPC. Codes are the same numbers on both sides; what is wrong with
/// which field travels as a google.rpc.BadRequest in the status details. Thread-safe.
namespace fovea::wire {

/// INVALID_ARGUMENT "PATH: DESCRIPTION", with the field's path in the request in the details.
[[nodiscard]] Status BadField(std::string_view path, std::string_view description);

/// frames::ValidateSpec and ResolveSpec start their messages with a field's name: adds the details
/// that point at that field of the FrameSpec at `path`. Other errors, and OK, are left as they are.
[[nodiscard]] Status PointAtSpecField(const Status& status, std::string_view path);

/// The path that the details of `status` point at; empty if they point at none.
[[nodiscard]] std::string FieldOf(const Status& status);

/// `status` with these details. `name` is what was asked for.
[[nodiscard]] Status WithResource(Status status, std::string_view type, std::string_view name);
[[nodiscard]] Status WithQuota(Status status, std::string_view subject,
                               std::string_view description);
[[nodiscard]] Status WithRetry(Status status, std::chrono::milliseconds delay);

/// When the details say that it is worth trying again.
[[nodiscard]] std::optional<std::chrono::milliseconds> RetryDelayOf(const Status& status);
/// Whether the details say that a quota is used up.
[[nodiscard]] bool HasQuota(const Status& status);
/// What the details say beyond the message, for people: "; try again in 1.5 s". May be empty.
[[nodiscard]] std::string DescribeDetails(const Status& status);
/// The same error in other words: `message`, and the details of `status`.
[[nodiscard]] Status WithMessage(const Status& status, std::string_view message);

[[nodiscard]] grpc::Status ToGrpc(const Status& status);
[[nodiscard]] Status FromGrpc(const grpc::Status& status);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_STATUS_H_
