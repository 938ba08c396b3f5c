#include "service/client/coefficient_reader.h"

#include <fmt/format.h>

namespace fovea::client {

CoefficientReader::CoefficientReader(v1::Coefficients::Stub& stub,
                                     const v1::StreamCoefficientsRequest& request,
                                     const CallMetadata& metadata, double deadline_seconds)
    : deadline_seconds_(deadline_seconds) {
  metadata.AddTo(&context_);
  reader_ = stub.PrepareAsyncStreamCoefficients(&context_, request, &queue_);
  reader_->StartCall(this);
  started_ = Wait();
}

CoefficientReader::~CoefficientReader() {
  context_.TryCancel();
  queue_.Shutdown();
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
  }
}

bool CoefficientReader::Next(v1::CoefficientBlock* block) {
  if (!started_) {
    return false;
  }
  reader_->Read(block, this);
  return Wait();
}

grpc::Status CoefficientReader::Finish() {
  grpc::Status status;
  reader_->Finish(&status, this);
  Wait();
  if (timed_out_) {
    return {grpc::StatusCode::DEADLINE_EXCEEDED,
            fmt::format("no coefficients came within {} s", deadline_seconds_)};
  }
  return status;
}

bool CoefficientReader::Wait() {
  void* tag = nullptr;
  bool ok = false;
  if (!timed_out_ && queue_.AsyncNext(&tag, &ok, DeadlineIn(deadline_seconds_)) !=
                         grpc::CompletionQueue::NextStatus::GOT_EVENT) {
    timed_out_ = true;
    context_.TryCancel();
  }
  if (timed_out_) {
    queue_.Next(&tag, &ok);  // the cancelled operation ends now
  }
  return ok && !timed_out_;
}

}  // namespace fovea::client
