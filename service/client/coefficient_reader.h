#ifndef SERVICE_CLIENT_COEFFICIENT_READER_H_
#define SERVICE_CLIENT_COEFFICIENT_READER_H_

#include <memory>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/async_stream.h>

#include "fovea/v1/coefficients.grpc.pb.h"
#include "service/client/call_options.h"

namespace fovea::client {

/// Reads one stream of coefficients in the caller's thread, each wait with a deadline of its own
/// (gRPC's counts for a whole call). Cancels what is left of the call when it goes. Not
/// thread-safe.
class CoefficientReader {
 public:
  CoefficientReader(v1::Coefficients::Stub& stub, const v1::StreamCoefficientsRequest& request,
                    const CallMetadata& metadata, double deadline_seconds);
  ~CoefficientReader();
  CoefficientReader(const CoefficientReader&) = delete;
  CoefficientReader& operator=(const CoefficientReader&) = delete;

  /// Waits for the next block; false at the end of the stream.
  [[nodiscard]] bool Next(v1::CoefficientBlock* block);
  /// How the stream ended, once Next has returned false.
  [[nodiscard]] grpc::Status Finish();

 private:
  /// Waits for the operation under way. False if it failed, or was cancelled for taking too long.
  bool Wait();

  const double deadline_seconds_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::ClientAsyncReader<v1::CoefficientBlock>> reader_;
  bool started_ = false;
  bool timed_out_ = false;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_COEFFICIENT_READER_H_
