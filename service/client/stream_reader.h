#ifndef SERVICE_CLIENT_STREAM_READER_H_
#define SERVICE_CLIENT_STREAM_READER_H_

#include <algorithm>
#include <chrono>
#include <memory>
#include <utility>

#include <fmt/format.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/async_stream.h>

#include "service/client/call_options.h"
#include "service/client/dataset_watch.h"

namespace fovea::client {

/// Reads one stream of a server in the caller's thread, each wait with a deadline of its own
/// (gRPC's counts for a whole call), until its end or until it is told to stop. Cancels what is
/// left of the call when it goes. Not thread-safe.
template <typename Message>
class StreamReader {
 public:
  static constexpr double kNoDeadline = 1e9;  // seconds

  /// `prepare(context, queue)` is the stub's PrepareAsync. `go_on` may be empty.
  template <typename Prepare>
  StreamReader(const CallMetadata& metadata, double deadline_seconds, GoOn go_on,
               const Prepare& prepare)
      : deadline_seconds_(deadline_seconds), go_on_(std::move(go_on)) {
    metadata.AddTo(&context_);
    reader_ = prepare(&context_, &queue_);
    reader_->StartCall(this);
    started_ = Wait();
  }
  ~StreamReader() {
    context_.TryCancel();
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }
  StreamReader(const StreamReader&) = delete;
  StreamReader& operator=(const StreamReader&) = delete;

  /// Waits for the next message; false at the end of the stream, or if it was stopped.
  [[nodiscard]] bool Next(Message* message) {
    if (!started_ || stopped_) {
      return false;
    }
    reader_->Read(message, this);
    return Wait();
  }
  /// `go_on` said no.
  [[nodiscard]] bool stopped() const { return stopped_; }
  /// How the stream ended, once Next has returned false.
  [[nodiscard]] grpc::Status Finish() {
    grpc::Status status;
    reader_->Finish(&status, this);
    static_cast<void>(Wait());
    if (timed_out_) {
      return {grpc::StatusCode::DEADLINE_EXCEEDED,
              fmt::format("nothing came within {} s", deadline_seconds_)};
    }
    return status;
  }

 private:
  /// Waits for the operation under way. False if it failed, or was cancelled for taking too long or
  /// by `go_on`.
  bool Wait() {
    constexpr double kTurnSeconds = 0.2;
    const auto end = DeadlineIn(deadline_seconds_);
    void* tag = nullptr;
    bool ok = false;
    while (!timed_out_ && !stopped_) {
      const auto turn = go_on_ ? std::min(end, DeadlineIn(kTurnSeconds)) : end;
      if (queue_.AsyncNext(&tag, &ok, turn) == grpc::CompletionQueue::NextStatus::GOT_EVENT) {
        return ok;
      }
      timed_out_ = std::chrono::system_clock::now() >= end;
      stopped_ = !timed_out_ && go_on_ && !go_on_();
    }
    context_.TryCancel();
    queue_.Next(&tag, &ok);  // the cancelled operation ends now
    return false;
  }

  const double deadline_seconds_;
  const GoOn go_on_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::ClientAsyncReader<Message>> reader_;
  bool started_ = false;
  bool timed_out_ = false;
  bool stopped_ = false;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_STREAM_READER_H_
