#include "service/client/acknowledger.h"

#include "service/client/call_options.h"

namespace fovea::client {

void Acknowledger::Acknowledge(uint64_t index) {
  {
    const std::lock_guard lock(mutex_);
    if (in_flight_) {
      next_ = index;
      return;
    }
    in_flight_ = true;
  }
  Send(index);
}

void Acknowledger::Send(uint64_t index) {
  const auto call = std::make_shared<Call>();
  call->context.AddMetadata(kSessionKey, session_);
  call->context.set_deadline(DeadlineIn(deadline_seconds_));
  call->request.set_stream_id(stream_id_);
  call->request.set_index(index);
  stub_->async()->Acknowledge(&call->context, &call->request, &call->response,
                              [self = shared_from_this(), call](const grpc::Status& /*status*/) {
                                std::optional<uint64_t> next;
                                {
                                  const std::lock_guard lock(self->mutex_);
                                  next = std::exchange(self->next_, std::nullopt);
                                  self->in_flight_ = next.has_value();
                                }
                                if (next) {
                                  self->Send(*next);
                                }
                              });
}

}  // namespace fovea::client
