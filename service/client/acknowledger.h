#ifndef SERVICE_CLIENT_ACKNOWLEDGER_H_
#define SERVICE_CLIENT_ACKNOWLEDGER_H_

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include <grpcpp/client_context.h>

#include "fovea/v1/render.grpc.pb.h"

namespace fovea::client {

/// Sends the acknowledgements of one stream without waiting for them: one at a time, always the
/// newest. Failures are left to the stream itself to notice (it stalls, or has ended already).
/// Thread-safe. Create with std::make_shared; calls under way keep it alive.
class Acknowledger : public std::enable_shared_from_this<Acknowledger> {
 public:
  Acknowledger(std::shared_ptr<v1::Render::Stub> stub, std::string stream_id, std::string session,
               double deadline_seconds)
      : stub_(std::move(stub)),
        stream_id_(std::move(stream_id)),
        session_(std::move(session)),
        deadline_seconds_(deadline_seconds) {}

  /// Every frame up to `index` was shown.
  void Acknowledge(uint64_t index);

 private:
  struct Call {
    grpc::ClientContext context;
    v1::AcknowledgeRequest request;
    v1::AcknowledgeResponse response;
  };
  void Send(uint64_t index);

  const std::shared_ptr<v1::Render::Stub> stub_;
  const std::string stream_id_;
  const std::string session_;
  const double deadline_seconds_;

  std::mutex mutex_;
  // Both guarded by mutex_.
  bool in_flight_ = false;
  std::optional<uint64_t> next_;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_ACKNOWLEDGER_H_
