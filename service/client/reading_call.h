#ifndef SERVICE_CLIENT_READING_CALL_H_
#define SERVICE_CLIENT_READING_CALL_H_

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include <grpcpp/client_context.h>
#include <grpcpp/support/sync_stream.h>

#include "engine/base/status.h"
#include "fovea/v1/ingest.grpc.pb.h"
#include "service/client/reading_sender.h"

namespace fovea::client {

/// One StreamReadings: a thread of its own takes in the answers, so that sending never waits for
/// them. Cancels what is left of the call when it goes. One thread at a time.
class ReadingCall {
 public:
  /// `prepare` adds metadata. `on_held` may be empty.
  ReadingCall(v1::Ingest::Stub& stub, const std::function<void(grpc::ClientContext*)>& prepare,
              OnHeld on_held);
  ~ReadingCall();
  ReadingCall(const ReadingCall&) = delete;
  ReadingCall& operator=(const ReadingCall&) = delete;

  /// False if the call is over.
  [[nodiscard]] bool Write(const v1::StreamReadingsRequest& message);
  /// The newest answer; waits for the first one for at most `seconds`. DEADLINE_EXCEEDED, or how
  /// the call ended before one came.
  [[nodiscard]] StatusOr<v1::StreamReadingsResponse> WaitForAnswer(double seconds);
  /// Nothing more will be written: how the call ends.
  [[nodiscard]] Status Finish();
  /// The newest answer, or an empty one.
  [[nodiscard]] v1::StreamReadingsResponse latest() const;

 private:
  void ReadAll();

  const OnHeld on_held_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::StreamReadingsRequest, v1::StreamReadingsResponse>>
      stream_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  v1::StreamReadingsResponse latest_;
  bool answered_ = false, over_ = false;
  Status end_;  // once over_
  std::thread reader_;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_READING_CALL_H_
