#include "service/server/view_reactors.h"

#include <chrono>
#include <memory>
#include <mutex>
#include <utility>

#include "service/server/admission.h"
#include "service/server/view_stream.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// What both share: a reactor that can write frames, and the stream behind it.
template <typename Reactor>
class FrameReactor : public Reactor, public FrameSink {
 public:
  FrameReactor(Services& services, const char* method)
      : stream_(std::make_shared<ViewStream>(services, *this, method)) {}

  void Write(const v1::Frame& frame) override { this->StartWrite(&frame); }
  void Finish(const Status& status) override { Reactor::Finish(wire::ToGrpc(status)); }
  void OnWriteDone(bool ok) override { stream_->OnWriteDone(ok); }
  void OnCancel() override { stream_->OnCancel(); }
  void OnDone() override { delete this; }

 protected:
  /// Whether the call was let in; it is over if not.
  bool Enter(Services& services, const grpc::CallbackServerContext& context, const Ask& ask) {
    auto admission = Admit(services, context, ask);
    if (!admission.ok()) {
      stream_->Start(admission.status());
      return false;
    }
    admission_ = *std::move(admission);
    stream_->Start(admission_.caller, admission_.client);
    return true;
  }

  const std::shared_ptr<ViewStream> stream_;

 private:
  Admission admission_;
};

class RefineReactor final : public FrameReactor<grpc::ServerWriteReactor<v1::Frame>> {
 public:
  RefineReactor(Services& services, const grpc::CallbackServerContext& context,
                const v1::RefineFrameRequest& request)
      : FrameReactor(services, "RefineFrame") {
    if (!Enter(services, context,
               {.dataset = request.dataset(), .request = &request, .stream = true})) {
      return;
    }
    auto view = wire::FromProto(request);
    if (view.ok()) {
      stream_->OnView(*std::move(view));
      stream_->OnNoMoreViews();
    } else {
      stream_->OnError(view.status());
    }
  }
};

class ExploreReactor final
    : public FrameReactor<grpc::ServerBidiReactor<v1::ExploreRequest, v1::Frame>> {
 public:
  ExploreReactor(Services& services, const grpc::CallbackServerContext& context)
      : FrameReactor(services, "Explore"), timer_(services.timer) {
    if (Enter(services, context, {.stream = true})) {
      StartRead(&request_);
    }
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      stream_->OnNoMoreViews();
      return;
    }
    const std::chrono::milliseconds wait = stream_->OnExploreRequest(request_);
    if (wait.count() == 0) {
      StartRead(&request_);
      return;
    }
    timer_.After(wait, [reading = reading_] {
      const std::lock_guard lock(reading->mutex);
      if (reading->reactor != nullptr) {
        reading->reactor->StartRead(&reading->reactor->request_);
      }
    });
  }
  void Finish(const Status& status) override {
    {
      const std::lock_guard lock(reading_->mutex);
      reading_->reactor = nullptr;  // nothing is read of a call that is over, and it may go
    }
    FrameReactor::Finish(status);
  }

 private:
  /// What a read that comes later needs, whether the reactor is there or not.
  struct LaterRead {
    explicit LaterRead(ExploreReactor* the_reactor) : reactor(the_reactor) {}
    std::mutex mutex;
    ExploreReactor* reactor;  // guarded by mutex; null once the call is over
  };

  Timer& timer_;
  const std::shared_ptr<LaterRead> reading_ = std::make_shared<LaterRead>(this);
  v1::ExploreRequest request_;  // gRPC's while a read is under way
};

}  // namespace

grpc::ServerWriteReactor<v1::Frame>* StartRefineFrame(Services& services,
                                                      const grpc::CallbackServerContext& context,
                                                      const v1::RefineFrameRequest& request) {
  return new RefineReactor(services, context, request);
}

grpc::ServerBidiReactor<v1::ExploreRequest, v1::Frame>* StartExplore(
    Services& services, const grpc::CallbackServerContext& context) {
  return new ExploreReactor(services, context);
}

}  // namespace fovea::server
