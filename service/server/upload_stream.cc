#include "service/server/upload_stream.h"

#include <span>
#include <utility>

#include "service/server/live_stream.h"
#include "service/wire/status.h"
#include "service/wire/upload.h"

namespace fovea::server {
namespace {

constexpr std::chrono::seconds kRetry{1};

ingest::DenseType TypeOf(wire::UploadSpec::Type type) {
  switch (type) {
    case wire::UploadSpec::Type::kUint8:
      return ingest::DenseType::kUint8;
    case wire::UploadSpec::Type::kInt8:
      return ingest::DenseType::kInt8;
    case wire::UploadSpec::Type::kUint16:
      return ingest::DenseType::kUint16;
    case wire::UploadSpec::Type::kInt16:
      return ingest::DenseType::kInt16;
    case wire::UploadSpec::Type::kFloat32:
      break;
  }
  return ingest::DenseType::kFloat32;
}

ingest::UploadPlan PlanOf(const wire::UploadSpec& spec) {
  ingest::UploadPlan plan;
  plan.step = spec.step;
  plan.time_ns = spec.time_ns;
  plan.frame_number = spec.frame_number;
  plan.dims = spec.dims;
  for (const wire::UploadSpec::Field& field : spec.fields) {
    plan.fields.push_back({field.name, TypeOf(field.type), field.value_unit});
  }
  plan.wavelet = spec.wavelet;
  plan.lossless = spec.lossless;
  plan.chunk_edge = spec.chunk_edge;
  plan.index_to_world = spec.index_to_world;
  plan.source = spec.source;
  plan.world_unit = spec.world_unit;
  return plan;
}

/// Where the dataset is, or is to be.
StatusOr<std::string> PathOf(Catalogue& catalogue, const std::string& name) {
  const auto found = catalogue.FindNow(name);
  if (found.ok()) {
    return (*found)->dataset().path();
  }
  // What is there and is no store is looked at by whoever makes one.
  return absl::IsDataLoss(found.status()) ? found.status() : catalogue.PathOfNew(name);
}

}  // namespace

void UploadStream::Start(const Status& admitted, std::shared_ptr<access::Caller> caller) {
  caller_ = std::move(caller);
  Status status = admitted;
  {
    const std::lock_guard lock(mutex_);
    if (status.ok()) {
      counted_ = true;
      if (++services_.live_streams > LiveStream::kMostStreams) {
        status = wire::WithRetry(
            ResourceExhausted("{} calls write already, which is this server's limit; try again "
                              "later",
                              LiveStream::kMostStreams),
            kRetry);
      }
    }
    if (!status.ok()) {
      end_ = status;
    }
  }
  Act();
}

void UploadStream::OnMessage(v1::UploadStepRequest message) {
  const auto bytes = static_cast<int64_t>(message.ByteSizeLong());
  Status status = caller_->TakeBytesIn(bytes);
  if (wire::RetryDelayOf(status)) {
    // Above its quota. It could not go on where it was, so it is held back.
    const std::lock_guard lock(mutex_);
    held_ = std::move(message);
    return;
  }
  if (status.ok() && bytes > wire::kMaxUploadMessageBytes) {
    status = wire::BadField(message.has_header() ? "header" : "piece",
                            fmt::format("has {} bytes, more than {}: send less data at a time",
                                        bytes, wire::kMaxUploadMessageBytes));
  }
  {
    const std::lock_guard lock(mutex_);
    reading_ = false;
    if (status.ok()) {
      waiting_bytes_ += static_cast<int64_t>(message.SpaceUsedLong());
      waiting_.push_back(std::move(message));
    }
  }
  Stop(status);
}

void UploadStream::OnReadsDone() {
  {
    const std::lock_guard lock(mutex_);
    reading_ = false;
    reads_done_ = true;
  }
  Act();
}

void UploadStream::OnCancel() {
  Stop(Cancelled("the client cancelled, went away, or its deadline passed"));
}

void UploadStream::OnNews(const DatasetNews& news) {
  if (news.closing) {
    Stop(DrainingError());
  }
}

bool UploadStream::OnTick(Clock::time_point now) {
  bool silent = false;
  std::optional<v1::UploadStepRequest> held;
  {
    const std::lock_guard lock(mutex_);
    if (finished_) {
      return false;
    }
    silent = reading_ && !held_ && now - read_since_ >= kMostIdle;
    held.swap(held_);
  }
  if (held) {
    OnMessage(*std::move(held));
  }
  if (silent) {
    Stop(MakeStatus(absl::StatusCode::kDeadlineExceeded,
                    fmt::format("nothing came for {} s: the step is dropped; send it again",
                                kMostIdle.count())));
  }
  return true;
}

/// Ends the call with the first error that it gets; goes on with OK.
void UploadStream::Stop(const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (!end_ && !status.ok()) {
      end_ = status;
    }
  }
  Act();
}

UploadStream::Actions UploadStream::Decide() {
  Actions actions;
  if (finished_) {
    return actions;
  }
  if (!end_ && !reading_ && !reads_done_ && waiting_bytes_ < kMostWaitingBytes) {
    reading_ = starting_read_ = actions.read = true;
    read_since_ = Clock::now();
  }
  // The last job of a call lets go of what it holds.
  const bool must_close = end_ && opened_ && !closed_;
  if (!working_ && (must_close || (!end_ && (!waiting_.empty() || reads_done_)))) {
    working_ = opened_ = actions.work = true;
  }
  if (end_ && !working_ && !starting_read_ && (closed_ || !opened_)) {
    finished_ = true;
    actions.finish = *end_;
  }
  return actions;
}

void UploadStream::Act() {
  Actions actions;
  {
    const std::lock_guard lock(mutex_);
    actions = Decide();
  }
  if (actions.work) {
    services_.ingests.SubmitAdmitted(0, [self = shared_from_this()](int) { self->Work(); });
  }
  if (actions.finish) {
    if (std::exchange(counted_, false)) {
      --services_.live_streams;
    }
    peer_.Finish(services_.catalogue->WithoutRoot(*actions.finish), response_);
    return;
  }
  if (actions.read) {
    peer_.Read();
    {
      const std::lock_guard lock(mutex_);
      starting_read_ = false;
    }
    Act();  // what waited for that
  }
}

void UploadStream::Work() {
  std::vector<v1::UploadStepRequest> messages;
  bool stop = false, complete = false;
  {
    const std::lock_guard lock(mutex_);
    stop = end_.has_value();
    complete = reads_done_;
    messages.swap(waiting_);
    waiting_bytes_ = 0;
  }
  Status status = stop ? absl::OkStatus() : Take(messages);
  const bool committed = status.ok() && upload_ != nullptr && upload_->committed();
  if (status.ok() && complete && !committed && !stop) {
    status = upload_ == nullptr
                 ? wire::BadField("header", "is missing: no message came")
                 : wire::BadField("piece.data",
                                  fmt::format("ended {} bytes before the end of field {}",
                                              upload_->awaited().bytes, upload_->awaited().field));
  }
  const bool close = stop || committed || !status.ok();
  if (close && upload_ != nullptr) {
    upload_.reset();
    services_.steps.Poke(spec_.dataset);  // a step more, or all of it is gone again
  }
  if (close) {
    memory_.clear();
  }
  {
    const std::lock_guard lock(mutex_);
    working_ = false;
    closed_ = close;
    if (close && !end_) {
      end_ = status;
    }
    if (committed) {
      end_ = absl::OkStatus();  // it stays, whatever came between
    }
  }
  Act();
}

Status UploadStream::Take(const std::vector<v1::UploadStepRequest>& messages) {
  for (const v1::UploadStepRequest& message : messages) {
    if (upload_ != nullptr && upload_->committed()) {
      return absl::OkStatus();  // what is there already is not taken
    }
    FOVEA_RETURN_IF_ERROR(upload_ == nullptr ? Open(message) : AddPiece(message));
  }
  return absl::OkStatus();
}

Status UploadStream::Open(const v1::UploadStepRequest& first) {
  if (!first.has_header()) {
    return wire::BadField("header", "is missing: the first message says what is uploaded");
  }
  FOVEA_ASSIGN_OR_RETURN(spec_, wire::FromProto(first.header()));
  if (!caller_->Sees(spec_.dataset)) {
    return NoDataset(spec_.dataset);
  }
  const ingest::UploadPlan plan = PlanOf(spec_);
  auto memory =
      services_.requests.Reserve(2 * kMostWaitingBytes + ingest::StepUpload::WorkingBytes(plan));
  FOVEA_RETURN_IF_ERROR(
      Annotate(memory.status(), fmt::format("layers of {} x {} voxels", plan.dims.x, plan.dims.y)));
  memory_.push_back(*std::move(memory));
  FOVEA_ASSIGN_OR_RETURN(const std::string path, PathOf(*services_.catalogue, spec_.dataset));
  FOVEA_ASSIGN_OR_RETURN(upload_,
                         ingest::StepUpload::Open(path, plan, services_.renders.threads()));
  services_.steps.Subscribe(spec_.dataset, weak_from_this());  // for when the server drains
  if (upload_->committed()) {
    const std::lock_guard lock(mutex_);
    response_ =
        wire::ToProto(spec_, {.already = true, .committed_steps = upload_->committed_steps()});
  }
  return absl::OkStatus();
}

Status UploadStream::AddPiece(const v1::UploadStepRequest& message) {
  if (!message.has_piece()) {
    return message.has_header()
               ? wire::BadField("header", "came twice: only the first message has one")
               : wire::BadField("piece", "is missing: the message is empty");
  }
  const v1::UploadPiece& piece = message.piece();
  const ingest::StepUpload::Awaited awaited = upload_->awaited();
  if (piece.field() != awaited.field) {
    return wire::BadField("piece.field", fmt::format("is {}, where field {} is awaited",
                                                     piece.field(), awaited.field));
  }
  if (piece.offset() != static_cast<uint64_t>(awaited.offset)) {
    return wire::BadField("piece.offset",
                          fmt::format("is {}, where byte {} of field {} is awaited", piece.offset(),
                                      awaited.offset, awaited.field));
  }
  const auto bytes = static_cast<int64_t>(piece.data().size());
  if (bytes < 1 || bytes > awaited.bytes) {
    return wire::BadField("piece.data", fmt::format("has {} bytes, and not 1 to the {} that are "
                                                    "missing of field {}",
                                                    bytes, awaited.bytes, awaited.field));
  }
  FOVEA_RETURN_IF_ERROR(upload_->Add(std::as_bytes(std::span(piece.data()))));
  if (!upload_->complete()) {
    return absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(upload_->Commit());
  const std::lock_guard lock(mutex_);
  response_ = wire::ToProto(spec_, {.already = false,
                                    .committed_steps = upload_->committed_steps(),
                                    .nonfinite_values = upload_->nonfinite_values()});
  return absl::OkStatus();
}

}  // namespace fovea::server
