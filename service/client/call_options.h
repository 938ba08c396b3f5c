#ifndef SERVICE_CLIENT_CALL_OPTIONS_H_
#define SERVICE_CLIENT_CALL_OPTIONS_H_

#include <chrono>
#include <string>

#include <grpcpp/client_context.h>

namespace fovea::client {

/// The metadata key by which proxies keep the calls of one viewer on one server.
inline constexpr char kSessionKey[] = "fovea-session";

[[nodiscard]] inline std::chrono::system_clock::time_point DeadlineIn(double seconds) {
  return std::chrono::system_clock::now() +
         std::chrono::duration_cast<std::chrono::system_clock::duration>(
             std::chrono::duration<double>(seconds));
}

/// What every call of a client carries.
struct CallMetadata {
  std::string session;
  std::string authorization;  // empty: none

  void AddTo(grpc::ClientContext* context) const {
    context->AddMetadata(kSessionKey, session);
    if (!authorization.empty()) {
      context->AddMetadata("authorization", authorization);
    }
  }
};

/// 128 random bits in hexadecimal: fit for a session and a stream_id.
[[nodiscard]] std::string RandomId();

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_CALL_OPTIONS_H_
