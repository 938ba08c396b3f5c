#ifndef ENGINE_BASE_STATUS_H_
#define ENGINE_BASE_STATUS_H_

#include <string>
#include <string_view>
#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <fmt/format.h>

/// Errors are absl::Status, whose codes are gRPC's. A message says what, where, and what to do.
/// Debian's Abseil has a string_view of its own, so messages are made and read through this file.
namespace fovea {

using absl::Status;
using absl::StatusOr;

/// The message as a standard view; valid as long as `status` lives.
[[nodiscard]] inline std::string_view MessageOf(const Status& status) {
  return {status.message().data(), status.message().size()};
}

[[nodiscard]] inline Status MakeStatus(absl::StatusCode code, std::string_view message) {
  return {code, absl::string_view(message.data(), message.size())};
}

/// The same error with "context: " in front; OK stays OK.
[[nodiscard]] inline Status Annotate(const Status& status, std::string_view context) {
  if (status.ok()) {
    return status;
  }
  return MakeStatus(status.code(), fmt::format("{}: {}", context, MessageOf(status)));
}

#define FOVEA_STATUS_MAKER(Name, code)                                          \
  template <typename... Args>                                                   \
  [[nodiscard]] Status Name(fmt::format_string<Args...> text, Args&&... args) { \
    return MakeStatus(code, fmt::format(text, std::forward<Args>(args)...));    \
  }
FOVEA_STATUS_MAKER(InvalidArgument, absl::StatusCode::kInvalidArgument)
FOVEA_STATUS_MAKER(NotFound, absl::StatusCode::kNotFound)
FOVEA_STATUS_MAKER(AlreadyExists, absl::StatusCode::kAlreadyExists)
FOVEA_STATUS_MAKER(OutOfRange, absl::StatusCode::kOutOfRange)
FOVEA_STATUS_MAKER(FailedPrecondition, absl::StatusCode::kFailedPrecondition)
FOVEA_STATUS_MAKER(ResourceExhausted, absl::StatusCode::kResourceExhausted)
FOVEA_STATUS_MAKER(DataLoss, absl::StatusCode::kDataLoss)
FOVEA_STATUS_MAKER(Internal, absl::StatusCode::kInternal)
FOVEA_STATUS_MAKER(Unavailable, absl::StatusCode::kUnavailable)
FOVEA_STATUS_MAKER(Cancelled, absl::StatusCode::kCancelled)
FOVEA_STATUS_MAKER(DeadlineExceeded, absl::StatusCode::kDeadlineExceeded)
#undef FOVEA_STATUS_MAKER

}  // namespace fovea

#define FOVEA_CONCAT_INNER(a, b) a##b
#define FOVEA_CONCAT(a, b) FOVEA_CONCAT_INNER(a, b)

/// Returns the error of `expression` (a Status), if it has one.
#define FOVEA_RETURN_IF_ERROR(expression)         \
  do {                                            \
    ::fovea::Status fovea_status_ = (expression); \
    if (!fovea_status_.ok())                      \
      return fovea_status_;                       \
  } while (false)

/// FOVEA_ASSIGN_OR_RETURN(auto x, MakeX()): assigns the value, or returns the error.
#define FOVEA_ASSIGN_OR_RETURN(target, expression) \
  FOVEA_ASSIGN_OR_RETURN_(FOVEA_CONCAT(fovea_result_, __LINE__), target, expression)
#define FOVEA_ASSIGN_OR_RETURN_(result, target, expression) \
  auto result = (expression);                               \
  if (!result.ok())                                         \
    return std::move(result).status();                      \
  target = std::move(result).value()

#endif  // ENGINE_BASE_STATUS_H_
