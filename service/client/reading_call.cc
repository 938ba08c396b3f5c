#include "service/client/reading_call.h"

#include <chrono>
#include <utility>

#include "service/wire/status.h"

namespace fovea::client {

ReadingCall::ReadingCall(v1::Ingest::Stub& stub,
                         const std::function<void(grpc::ClientContext*)>& prepare, OnHeld on_held)
    : on_held_(std::move(on_held)) {
  prepare(&context_);
  stream_ = stub.StreamReadings(&context_);
  reader_ = std::thread([this] { ReadAll(); });
}

ReadingCall::~ReadingCall() {
  context_.TryCancel();
  reader_.join();
}

void ReadingCall::ReadAll() {
  v1::StreamReadingsResponse response;
  while (stream_->Read(&response)) {
    {
      const std::lock_guard lock(mutex_);
      latest_ = response;
      answered_ = true;
      changed_.notify_all();
    }
    const HeldBack held{response.held_seconds(), response.acknowledged(),
                        static_cast<int64_t>(response.committed_steps())};
    if (held.seconds > 0 && on_held_ && !on_held_(held)) {
      context_.TryCancel();
    }
  }
  Status end = wire::FromGrpc(stream_->Finish());
  const std::lock_guard lock(mutex_);
  end_ = std::move(end);
  over_ = true;
  changed_.notify_all();
}

bool ReadingCall::Write(const v1::StreamReadingsRequest& message) {
  return stream_->Write(message);
}

StatusOr<v1::StreamReadingsResponse> ReadingCall::WaitForAnswer(double seconds) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                         [this] { return answered_ || over_; })) {
    return MakeStatus(absl::StatusCode::kDeadlineExceeded, "no answer came in time");
  }
  if (answered_) {
    return latest_;
  }
  return end_.ok() ? Internal("the call ended without an answer") : end_;
}

Status ReadingCall::Finish() {
  stream_->WritesDone();
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return over_; });
  return end_;
}

v1::StreamReadingsResponse ReadingCall::latest() const {
  const std::lock_guard lock(mutex_);
  return latest_;
}

}  // namespace fovea::client
