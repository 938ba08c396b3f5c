#include "service/client/event_reader.h"

#include "service/wire/status.h"

namespace fovea::client {
namespace {

constexpr double kTurnSeconds = 0.2;

StatusOr<DatasetEvent> FromProto(const v1::DatasetEvent& proto) {
  DatasetEvent event;
  event.present = proto.state() == v1::DatasetEvent::PRESENT;
  event.committed_steps = static_cast<int64_t>(proto.committed_steps());
  if (event.committed_steps < 0 || proto.state() == v1::DatasetEvent::STATE_UNSPECIFIED) {
    return Internal("an event of no state, or of {} steps", proto.committed_steps());
  }
  for (const v1::DatasetEvent::Step& from : proto.steps()) {
    if (from.step() >= proto.committed_steps()) {
      return Internal("an event of step {} where {} are committed", from.step(),
                      proto.committed_steps());
    }
    DatasetEvent::Step& step = event.steps.emplace_back();
    step.step = static_cast<int64_t>(from.step());
    step.time_ns = from.time_ns();
    if (from.has_frame_number()) {
      step.frame_number = from.frame_number();
    }
  }
  return event;
}

}  // namespace

EventReader::EventReader(v1::Datasets::Stub& stub, const v1::WatchDatasetRequest& request,
                         const CallMetadata& metadata) {
  metadata.AddTo(&context_);
  reader_ = stub.PrepareAsyncWatchDataset(&context_, request, &queue_);
  reader_->StartCall(this);
}

EventReader::~EventReader() {
  context_.TryCancel();
  queue_.Shutdown();
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
  }
}

bool EventReader::Wait(const GoOn& go_on) {
  void* tag = nullptr;
  bool ok = false;
  while (queue_.AsyncNext(&tag, &ok, DeadlineIn(kTurnSeconds)) ==
         grpc::CompletionQueue::NextStatus::TIMEOUT) {
    if (!stopped_ && go_on != nullptr && !go_on()) {
      stopped_ = true;
      context_.TryCancel();  // the operation ends now
    }
  }
  return ok && !stopped_;
}

Status EventReader::Run(const OnEvent& on_event, const GoOn& go_on) {
  v1::DatasetEvent proto;
  bool reading = Wait(go_on);
  while (reading) {
    reader_->Read(&proto, this);
    reading = Wait(go_on);
    if (reading) {
      FOVEA_ASSIGN_OR_RETURN(const DatasetEvent event, FromProto(proto));
      stopped_ = !on_event(event);
      reading = !stopped_;
    }
  }
  if (stopped_) {
    return absl::OkStatus();
  }
  grpc::Status status;
  reader_->Finish(&status, this);
  static_cast<void>(Wait(nullptr));
  return wire::FromGrpc(status);
}

}  // namespace fovea::client
