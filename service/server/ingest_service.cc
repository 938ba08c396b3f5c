#include "service/server/ingest_service.h"

#include <chrono>
#include <memory>
#include <utility>

#include "service/server/admission.h"
#include "service/server/live_stream.h"
#include "service/server/new_job.h"
#include "service/server/unary_call.h"
#include "service/server/upload_stream.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// A LiveStream on gRPC. Deletes itself when gRPC is done with it; the stream lives on for as long
/// as jobs of it do.
class ReadingsReactor final
    : public grpc::ServerBidiReactor<v1::StreamReadingsRequest, v1::StreamReadingsResponse>,
      public ReadingsPeer {
 public:
  ReadingsReactor(Services& services, const grpc::CallbackServerContext& context)
      : stream_(std::make_shared<LiveStream>(services, *this)) {
    // Which dataset the first message says: the stream asks whether the caller may see it.
    auto admission = Admit(services, context, {.right = access::Right::kWrite, .stream = true});
    if (!admission.ok()) {
      stream_->Start(admission.status(), nullptr);
      return;
    }
    admission_ = *std::move(admission);
    stream_->Start(absl::OkStatus(), admission_.caller);
  }

  void Read() override { StartRead(&request_); }
  void Write(const v1::StreamReadingsResponse& response) override { StartWrite(&response); }
  void Finish(const Status& status) override { ServerBidiReactor::Finish(wire::ToGrpc(status)); }
  void OnReadDone(bool ok) override {
    if (ok) {
      stream_->OnMessage(std::exchange(request_, {}));
    } else {
      stream_->OnReadsDone();
    }
  }
  void OnWriteDone(bool ok) override { stream_->OnWriteDone(ok); }
  void OnCancel() override { stream_->OnCancel(); }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
  v1::StreamReadingsRequest request_;  // gRPC's while a read is under way
  const std::shared_ptr<LiveStream> stream_;
};

/// Looks after a stream's OnTick until it is over.
void KeepTicking(Timer& timer, std::weak_ptr<UploadStream> stream) {
  timer.After(UploadStream::kTick, [&timer, weak = std::move(stream)] {
    const auto ticked = weak.lock();
    if (ticked != nullptr && ticked->OnTick(UploadStream::Clock::now())) {
      KeepTicking(timer, ticked);
    }
  });
}

/// An UploadStream on gRPC, as ReadingsReactor.
class UploadReactor final : public grpc::ServerReadReactor<v1::UploadStepRequest>,
                            public UploadPeer {
 public:
  UploadReactor(Services& services, const grpc::CallbackServerContext& context,
                v1::UploadStepResponse* response)
      : response_(response), stream_(std::make_shared<UploadStream>(services, *this)) {
    auto admission = Admit(services, context, {.right = access::Right::kWrite, .stream = true});
    if (!admission.ok()) {
      stream_->Start(admission.status(), nullptr);
      return;
    }
    admission_ = *std::move(admission);
    KeepTicking(services.timer, stream_);
    stream_->Start(absl::OkStatus(), admission_.caller);
  }

  void Read() override { StartRead(&request_); }
  void Finish(const Status& status, const v1::UploadStepResponse& response) override {
    *response_ = response;
    ServerReadReactor::Finish(wire::ToGrpc(status));
  }
  void OnReadDone(bool ok) override {
    if (ok) {
      stream_->OnMessage(std::exchange(request_, {}));
    } else {
      stream_->OnReadsDone();
    }
  }
  void OnCancel() override { stream_->OnCancel(); }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
  v1::UploadStepRequest request_;           // gRPC's while a read is under way
  v1::UploadStepResponse* const response_;  // gRPC's; written before Finish
  const std::shared_ptr<UploadStream> stream_;
};

}  // namespace

grpc::ServerReadReactor<v1::UploadStepRequest>* IngestService::UploadStep(
    grpc::CallbackServerContext* context, v1::UploadStepResponse* response) {
  return new UploadReactor(services_, *context, response);  // deletes itself
}

grpc::ServerBidiReactor<v1::StreamReadingsRequest, v1::StreamReadingsResponse>*
IngestService::StreamReadings(grpc::CallbackServerContext* context) {
  return new ReadingsReactor(services_, *context);  // deletes itself
}

grpc::ServerUnaryReactor* IngestService::IngestFiles(grpc::CallbackServerContext* context,
                                                     const v1::IngestFilesRequest* request,
                                                     v1::Job* response) {
  const auto call = UnaryCall<v1::Job>::Start(
      services_, *context,
      {.right = access::Right::kWrite, .dataset = request->dataset(), .request = request},
      response);
  call->Enqueue(services_.lookups, 0, [call, &services = services_, request = *request](int) {
    call->Complete(NewIngest(services, call->caller(), request));
  });
  return call.get();
}

}  // namespace fovea::server
