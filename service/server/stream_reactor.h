#ifndef SERVICE_SERVER_STREAM_REACTOR_H_
#define SERVICE_SERVER_STREAM_REACTOR_H_

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include <grpcpp/support/server_callback.h>

#include "service/server/admission.h"
#include "service/wire/coefficient_messages.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {

/// A stream of messages about one dataset, on gRPC. `Stream` (SequenceStream, say) does the work
/// and writes to this as its `Sink`. Deletes itself when gRPC is done with it; the stream lives on
/// for as long as jobs of it do.
template <typename Message, typename Sink, typename Stream>
class StreamReactor final : public grpc::ServerWriteReactor<Message>, public Sink {
 public:
  /// `arguments` are the stream's, behind the services and the sink.
  template <typename Request, typename... Arguments>
  StreamReactor(Services& services, const grpc::CallbackServerContext& context,
                const Request& request, Arguments... arguments)
      : stream_(std::make_shared<Stream>(services, *this, arguments...)) {
    auto admission = Admit(services, context,
                           {.dataset = request.dataset(), .request = &request, .stream = true});
    if (!admission.ok()) {
      stream_->Start(admission.status(), nullptr);
      return;
    }
    admission_ = *std::move(admission);
    auto parsed = wire::FromProto(request);
    if constexpr (requires { stream_->Start(parsed, admission_.caller, admission_.client); }) {
      stream_->Start(std::move(parsed), admission_.caller, admission_.client);
    } else {  // it queues nothing, so that clients need not take turns
      stream_->Start(std::move(parsed), admission_.caller);
    }
  }

  void Write(const Message& message) override { this->StartWrite(&message); }
  void Finish(const Status& status) override {
    grpc::ServerWriteReactor<Message>::Finish(wire::ToGrpc(status));
  }
  void OnWriteDone(bool ok) override { stream_->OnWriteDone(ok); }
  void OnCancel() override { stream_->OnCancel(); }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
  const std::shared_ptr<Stream> stream_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_STREAM_REACTOR_H_
