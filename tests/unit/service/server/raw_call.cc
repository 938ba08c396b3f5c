#include "tests/unit/service/server/raw_call.h"

#include <grpcpp/generic/generic_stub.h>

#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// One call of bytes, driven step by step: each step waits for its own completion.
class Driver {
 public:
  Driver(const std::shared_ptr<grpc::Channel>& channel, const RawCall& call) : stub_(channel) {
    const auto now = std::chrono::system_clock::now();
    cancel_at_ = now + call.cancel_after;
    context_.set_deadline(now + call.deadline);
    stream_ = stub_.PrepareCall(&context_, call.method, &queue_);
    stream_->StartCall(&start_);
    Await(&start_);
  }
  ~Driver() {
    queue_.Shutdown();
    void* tag = nullptr;
    for (bool ok = false; queue_.Next(&tag, &ok);) {
    }
  }
  Driver(const Driver&) = delete;
  Driver& operator=(const Driver&) = delete;

  bool Write(const std::string& bytes) {
    const grpc::Slice slice(bytes);
    stream_->Write(grpc::ByteBuffer(&slice, 1), &write_);
    return Await(&write_);
  }
  void HalfClose() {
    stream_->WritesDone(&write_);
    Await(&write_);
  }
  bool Read() {
    grpc::ByteBuffer reply;
    stream_->Read(&reply, &read_);
    return Await(&read_);
  }
  void Cancel() {
    context_.TryCancel();
    cancelled_ = true;
  }
  [[nodiscard]] bool cancelled() const { return cancelled_; }
  Status Finish() {
    grpc::Status status;
    stream_->Finish(&status, &finish_);
    Await(&finish_);
    return wire::FromGrpc(status);
  }

 private:
  /// Only one thing is under way at a time.
  bool Await(const char* tag) {
    using NextStatus = grpc::CompletionQueue::NextStatus;
    void* done = nullptr;
    bool ok = false;
    while (true) {
      const NextStatus next = cancelled_
                                  ? queue_.AsyncNext(&done, &ok, gpr_inf_future(GPR_CLOCK_REALTIME))
                                  : queue_.AsyncNext(&done, &ok, cancel_at_);
      if (next == NextStatus::TIMEOUT) {
        Cancel();
      } else if (next == NextStatus::SHUTDOWN || done == tag) {
        return ok;
      }
    }
  }

  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream_;
  std::chrono::system_clock::time_point cancel_at_;
  bool cancelled_ = false;
  char start_ = 0, write_ = 0, read_ = 0, finish_ = 0;
};

}  // namespace

RawReply Send(const std::shared_ptr<grpc::Channel>& channel, const RawCall& call) {
  Driver driver(channel, call);
  RawReply reply;
  bool open = true;
  for (size_t i = 0; open && i < call.messages.size(); ++i) {
    open = driver.Write(call.messages[i]);
  }
  if (open && call.half_close) {
    driver.HalfClose();
  }
  while (driver.Read()) {
    if (++reply.replies >= call.most_replies && !driver.cancelled()) {
      driver.Cancel();
    }
  }
  reply.cancelled = driver.cancelled();
  reply.status = driver.Finish();
  return reply;
}

}  // namespace fovea::server
