#ifndef SERVICE_SERVER_COEFFICIENTS_SERVICE_H_
#define SERVICE_SERVER_COEFFICIENTS_SERVICE_H_

#include "fovea/v1/coefficients.grpc.pb.h"
#include "service/server/services.h"

namespace fovea::server {

/// fovea.v1.Coefficients. Thread-safe.
class CoefficientsService final : public v1::Coefficients::CallbackService {
 public:
  explicit CoefficientsService(Services& services) : services_(services) {}

  grpc::ServerWriteReactor<v1::CoefficientBlock>* StreamCoefficients(
      grpc::CallbackServerContext* context, const v1::StreamCoefficientsRequest* request) override;

 private:
  Services& services_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_COEFFICIENTS_SERVICE_H_
