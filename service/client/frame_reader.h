#ifndef SERVICE_CLIENT_FRAME_READER_H_
#define SERVICE_CLIENT_FRAME_READER_H_

#include <memory>
#include <string>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/async_stream.h>

#include "fovea/v1/render.grpc.pb.h"

namespace fovea::client {

/// Reads one stream of frames, each wait with a deadline of its own (gRPC's counts for a whole
/// call). Cancels what is left of the call when it goes. Not thread-safe.
class FrameReader {
 public:
  FrameReader(v1::Render::Stub& stub, const v1::RenderSequenceRequest& request,
              const std::string& session, double deadline_seconds);
  ~FrameReader();
  FrameReader(const FrameReader&) = delete;
  FrameReader& operator=(const FrameReader&) = delete;

  /// Waits for the next frame; false at the end of the stream.
  [[nodiscard]] bool Next(v1::Frame* frame);
  /// How the stream ended, once Next has returned false.
  [[nodiscard]] grpc::Status Finish();

 private:
  /// Waits for the operation under way. False if it failed, or was cancelled for taking too long.
  bool Wait();

  const double deadline_seconds_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::ClientAsyncReader<v1::Frame>> reader_;
  bool started_ = false;
  bool timed_out_ = false;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_FRAME_READER_H_
