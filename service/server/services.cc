#include "service/server/services.h"

#include <spdlog/spdlog.h>

#include "service/wire/status.h"

namespace fovea::server {
namespace {

spdlog::level::level_enum LevelOf(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
      return spdlog::level::debug;
    case absl::StatusCode::kResourceExhausted:
      return spdlog::level::warn;
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kUnknown:
      return spdlog::level::err;
    default:
      return spdlog::level::info;
  }
}

}  // namespace

Status DrainingError() {
  return Unavailable("the server is shutting down and takes no new calls; ask another, or later");
}

void LogOutcome(std::string_view method, std::string_view subject, const Status& status,
                double milliseconds) {
  spdlog::log(LevelOf(status.code()), "{} '{}': {} in {:.1f} ms{}{}", method,
              wire::Printable(subject), absl::StatusCodeToString(status.code()), milliseconds,
              status.ok() ? "" : ": ", wire::Printable(MessageOf(status), 1000));
}

}  // namespace fovea::server
