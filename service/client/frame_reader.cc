#include "service/client/frame_reader.h"

#include <fmt/format.h>

#include "service/client/call_options.h"

namespace fovea::client {

FrameReader::FrameReader(v1::Render::Stub& stub, const v1::RenderSequenceRequest& request,
                         const std::string& session, double deadline_seconds)
    : deadline_seconds_(deadline_seconds) {
  context_.AddMetadata(kSessionKey, session);
  reader_ = stub.PrepareAsyncRenderSequence(&context_, request, &queue_);
  reader_->StartCall(this);
  started_ = Wait();
}

FrameReader::~FrameReader() {
  context_.TryCancel();
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
  void* tag = nullptr;
  bool ok = false;
  if (queue_.AsyncNext(&tag, &ok, DeadlineIn(deadline_seconds_)) ==
      grpc::CompletionQueue::NextStatus::GOT_EVENT) {
    return ok;
  }
  timed_out_ = true;
  context_.TryCancel();  // the operation under way ends now
  queue_.Next(&tag, &ok);
  return false;
}

}  // namespace fovea::client
