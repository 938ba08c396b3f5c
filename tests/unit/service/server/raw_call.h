#ifndef TESTS_UNIT_SERVICE_SERVER_RAW_CALL_H_
#define TESTS_UNIT_SERVICE_SERVER_RAW_CALL_H_

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "engine/base/status.h"

namespace fovea::server {

/// What a call of bytes does, besides sending them one message after the other.
struct RawCall {
  std::string method;                 // "/package.Service/Method"
  std::vector<std::string> messages;  // none: it begins with the client's end
  bool half_close = true;             // else the client never says that it is done
  size_t most_replies = 1;            // then it is cancelled
  std::chrono::microseconds cancel_after =
      std::chrono::hours(1);  // from its start on, wherever it is
  std::chrono::milliseconds deadline{20'000};
};

struct RawReply {
  Status status;           // CANCELLED if the caller cancelled it
  size_t replies = 0;      // messages that came
  bool cancelled = false;  // by us: enough came, or it was time
};

/// Makes the call, of any kind of method, and waits for its end.
[[nodiscard]] RawReply Send(const std::shared_ptr<grpc::Channel>& channel, const RawCall& call);

}  // namespace fovea::server

#endif  // TESTS_UNIT_SERVICE_SERVER_RAW_CALL_H_
