#include "service/client/frame_reader.h"

#include <utility>

#include <fmt/format.h>

namespace fovea::client {

FrameReader::FrameReader(v1::Render::Stub& stub, const v1::RenderSequenceRequest& request,
                         const CallMetadata& metadata, double deadline_seconds)
    : stub_(stub),
      metadata_(metadata),
      stream_id_(request.stream_id()),
      deadline_seconds_(deadline_seconds) {
  metadata_.AddTo(&context_);
  reader_ = stub_.PrepareAsyncRenderSequence(&context_, request, &queue_);
  reader_->StartCall(this);
  started_ = Wait();
}

FrameReader::~FrameReader() {
  context_.TryCancel();
  if (acknowledgement_ != nullptr) {
    acknowledgement_->context.TryCancel();
  }
  queue_.Shutdown();
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
  }
}

bool FrameReader::Next(v1::Frame* frame) {
  if (!started_) {
    return false;
  }
  reader_->Read(frame, this);
  return Wait();
}

void FrameReader::Acknowledge(uint64_t index) {
  if (acknowledgement_ != nullptr) {
    next_acknowledged_ = index;
    return;
  }
  acknowledgement_ = std::make_unique<Acknowledgement>();
  metadata_.AddTo(&acknowledgement_->context);
  acknowledgement_->context.set_deadline(DeadlineIn(deadline_seconds_));
  v1::AcknowledgeRequest request;
  request.set_stream_id(stream_id_);
  request.set_index(index);
  acknowledgement_->call =
      stub_.PrepareAsyncAcknowledge(&acknowledgement_->context, request, &queue_);
  acknowledgement_->call->StartCall();
  acknowledgement_->call->Finish(&acknowledgement_->response, &acknowledgement_->status,
                                 acknowledgement_.get());
}

void FrameReader::AcknowledgementIsDone() {
  acknowledgement_.reset();
  if (next_acknowledged_) {
    Acknowledge(*std::exchange(next_acknowledged_, std::nullopt));
  }
}

grpc::Status FrameReader::Finish() {
  grpc::Status status;
  reader_->Finish(&status, this);
  Wait();
  if (timed_out_) {
    return {grpc::StatusCode::DEADLINE_EXCEEDED,
            fmt::format("no frame came within {} s", deadline_seconds_)};
  }
  return status;
}

bool FrameReader::Wait() {
  const auto deadline = DeadlineIn(deadline_seconds_);
  void* tag = nullptr;
  bool ok = false;
  while (true) {
    if (timed_out_) {
      queue_.Next(&tag, &ok);  // the cancelled operation ends now
    } else if (queue_.AsyncNext(&tag, &ok, deadline) !=
               grpc::CompletionQueue::NextStatus::GOT_EVENT) {
      timed_out_ = true;
      context_.TryCancel();
      continue;
    }
    if (tag == this) {
      return ok && !timed_out_;
    }
    AcknowledgementIsDone();
  }
}

}  // namespace fovea::client
