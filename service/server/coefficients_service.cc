#include "service/server/coefficients_service.h"

#include "service/server/coefficient_stream.h"
#include "service/server/stream_reactor.h"

namespace fovea::server {
grpc::ServerWriteReactor<v1::CoefficientBlock>* CoefficientsService::StreamCoefficients(
    grpc::CallbackServerContext* context, const v1::StreamCoefficientsRequest* request) {
  using Reactor = StreamReactor<v1::CoefficientBlock, BlockSink, CoefficientStream>;
  return new Reactor(services_, *context, *request);  // deletes itself
}

}  // namespace fovea::server
