#ifndef SERVICE_CLIENT_FRAME_READER_H_
#define SERVICE_CLIENT_FRAME_READER_H_

#include <memory>
#include <optional>
#include <string>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/async_stream.h>
#include <grpcpp/support/async_unary_call.h>

#include "fovea/v1/render.grpc.pb.h"
#include "service/client/call_options.h"

namespace fovea::client {

/// Reads one stream of frames, each wait with a deadline of its own (gRPC's counts for a whole
/// call), and sends its acknowledgements. Cancels what is left of the calls when it goes. All of it
/// runs in the caller's thread, through one completion queue: a callback that outlived the stream
/// could hold the last reference to the channel, which gRPC 1.51 cannot bear. Not thread-safe.
class FrameReader {
 public:
  FrameReader(v1::Render::Stub& stub, const v1::RenderSequenceRequest& request,
              const CallMetadata& metadata, double deadline_seconds);
  ~FrameReader();
  FrameReader(const FrameReader&) = delete;
  FrameReader& operator=(const FrameReader&) = delete;

  /// Waits for the next frame; false at the end of the stream.
  [[nodiscard]] bool Next(v1::Frame* frame);
  /// Every frame up to `index` was shown. Does not wait: one acknowledgement is under way at a
  /// time, and the newest follows it during Next. A failure is left to the stream to notice.
  void Acknowledge(uint64_t index);
  /// How the stream ended, once Next has returned false.
  [[nodiscard]] grpc::Status Finish();

 private:
  struct Acknowledgement {
    grpc::ClientContext context;
    v1::AcknowledgeResponse response;
    grpc::Status status;
    std::unique_ptr<grpc::ClientAsyncResponseReader<v1::AcknowledgeResponse>> call;
  };

  /// Waits for the stream's operation under way. False if it failed, or was cancelled for taking
  /// too long.
  bool Wait();
  void AcknowledgementIsDone();

  v1::Render::Stub& stub_;
  const CallMetadata metadata_;
  const std::string stream_id_;
  const double deadline_seconds_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::ClientAsyncReader<v1::Frame>> reader_;
  std::unique_ptr<Acknowledgement> acknowledgement_;  // under way, or null
  std::optional<uint64_t> next_acknowledged_;
  bool started_ = false;
  bool timed_out_ = false;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_FRAME_READER_H_
