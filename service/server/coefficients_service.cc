#include "service/server/coefficients_service.h"

#include <memory>
#include <utility>

#include "service/server/admission.h"
#include "service/server/coefficient_stream.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// A CoefficientStream on gRPC. Deletes itself when gRPC is done with it; the stream lives on for
/// as long as jobs of it do.
class CoefficientReactor final : public grpc::ServerWriteReactor<v1::CoefficientBlock>,
                                 public BlockSink {
 public:
  CoefficientReactor(Services& services, const grpc::CallbackServerContext& context,
                     const v1::StreamCoefficientsRequest& request)
      : stream_(std::make_shared<CoefficientStream>(services, *this)) {
    auto admission = Admit(services, context,
                           {.dataset = request.dataset(),
                            .bytes_in = static_cast<int64_t>(request.ByteSizeLong()),
                            .stream = true});
    if (!admission.ok()) {
      stream_->Start(admission.status(), nullptr);
      return;
    }
    admission_ = *std::move(admission);
    stream_->Start(wire::FromProto(request), admission_.caller, admission_.client);
  }

  void Write(const v1::CoefficientBlock& block) override { StartWrite(&block); }
  void Finish(const Status& status) override {
    grpc::ServerWriteReactor<v1::CoefficientBlock>::Finish(wire::ToGrpc(status));
  }
  void OnWriteDone(bool ok) override { stream_->OnWriteDone(ok); }
  void OnCancel() override { stream_->OnCancel(); }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
  const std::shared_ptr<CoefficientStream> stream_;
};

}  // namespace

grpc::ServerWriteReactor<v1::CoefficientBlock>* CoefficientsService::StreamCoefficients(
    grpc::CallbackServerContext* context, const v1::StreamCoefficientsRequest* request) {
  return new CoefficientReactor(services_, *context, *request);  // deletes itself
}

}  // namespace fovea::server
