#include "service/server/live_stream.h"

#include <algorithm>
#include <utility>

#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// Set aside at a time: the first block is for messages that wait and the batch in hand.
constexpr int64_t kMemoryBlock = int64_t{8} << 20;
constexpr std::chrono::seconds kRetry{1};
/// While a client is held back: its token may be taken away.
constexpr std::chrono::milliseconds kMostUnwatched{1000};

Status CancelledByClient() {
  return Cancelled("the client cancelled, went away, or its deadline passed");
}

}  // namespace

void LiveStream::Start(const Status& admitted, std::shared_ptr<access::Caller> caller) {
  caller_ = std::move(caller);
  Status status = admitted;
  {
    const std::lock_guard lock(mutex_);
    if (status.ok()) {
      counted_ = true;
      if (++services_.live_streams > kMostStreams) {
        status = wire::WithRetry(
            ResourceExhausted("{} streams of readings are written already, which is this server's "
                              "limit; try again later",
                              kMostStreams),
            kRetry);
      }
    }
    end_ = status;
  }
  Act();
}

void LiveStream::OnMessage(v1::StreamReadingsRequest message) {
  const auto bytes = static_cast<int64_t>(message.ByteSizeLong());
  const auto wait = caller_->SpendBytesIn(bytes);
  Status status = wait.status();
  if (status.ok() && bytes > wire::kMaxReadingsMessageBytes) {
    status = wire::BadField(message.has_header() ? "header" : "batch",
                            fmt::format("has {} bytes, more than {}: send smaller batches", bytes,
                                        wire::kMaxReadingsMessageBytes));
  }
  {
    const std::lock_guard lock(mutex_);
    reading_ = false;
    if (status.ok()) {
      waiting_bytes_ += static_cast<int64_t>(message.SpaceUsedLong());
      waiting_.push_back(std::move(message));
      HoldBack(*wait);
    }
  }
  Stop(status);
}

void LiveStream::HoldBack(std::chrono::milliseconds wait) {
  held_ = wait;
  if (wait.count() > 0) {
    has_response_ = answered_;
    services_.timer.After(std::min(wait, kMostUnwatched), [weak = weak_from_this()] {
      if (const auto self = weak.lock()) {
        self->LookAgain();
      }
    });
  }
}

void LiveStream::LookAgain() {
  const auto wait = caller_->SpendBytesIn(0);
  if (wait.ok()) {
    const std::lock_guard lock(mutex_);
    if (!finished_) {
      HoldBack(*wait);
    }
  }
  Stop(wait.status());
}

void LiveStream::OnReadsDone() {
  {
    const std::lock_guard lock(mutex_);
    reading_ = false;
    reads_done_ = true;
  }
  Act();
}

void LiveStream::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    cancelled_ = cancelled_ || !ok;
  }
  Act();
}

void LiveStream::OnCancel() {
  {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
  }
  Act();
}

void LiveStream::OnNews(const DatasetNews& news) {
  if (news.closing) {
    Stop(DrainingError());
  }
}

/// Ends the stream with the first error that it gets; goes on with OK.
void LiveStream::Stop(const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (end_.ok()) {
      end_ = status;
    }
  }
  Act();
}

LiveStream::Actions LiveStream::Decide() {
  Actions actions;
  if (finished_) {
    return actions;
  }
  if (!Stopping() && !reading_ && !reads_done_ && held_.count() == 0 &&
      waiting_bytes_ < kMostWaitingBytes) {
    reading_ = starting_read_ = actions.read = true;
  }
  // Of a stream that stops, the last job closes the store.
  const bool complete = reads_done_ && waiting_.empty();
  const bool must_close = opened_ && !closed_ && (Stopping() || complete);
  if (!working_ && (must_close || (!Stopping() && !waiting_.empty()))) {
    working_ = opened_ = actions.work = true;
  }
  if (!writing_ && has_response_ && !cancelled_ && !working_) {
    has_response_ = false;
    writing_response_ = response_;
    writing_response_.set_held_seconds(std::chrono::duration<double>(held_).count());
    writing_ = actions.write = true;
  }
  const bool done = Stopping() || complete;
  if (done && !working_ && !writing_ && !starting_read_ && (closed_ || !opened_)) {
    finished_ = true;
    actions.finish = cancelled_ ? CancelledByClient() : end_;
  }
  return actions;
}

void LiveStream::Act() {
  Actions actions;
  {
    const std::lock_guard lock(mutex_);
    actions = Decide();
  }
  if (actions.work) {
    services_.ingests.SubmitAdmitted(0, [self = shared_from_this()](int) { self->Work(); });
  }
  if (actions.write) {
    peer_.Write(writing_response_);
  }
  if (actions.finish) {
    if (std::exchange(counted_, false)) {
      --services_.live_streams;
    }
    peer_.Finish(services_.catalogue->WithoutRoot(*actions.finish));
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

void LiveStream::Work() {
  std::vector<v1::StreamReadingsRequest> messages;
  bool stop = false, complete = false;
  {
    const std::lock_guard lock(mutex_);
    stop = Stopping();
    complete = reads_done_;
    messages.swap(waiting_);
    waiting_bytes_ = 0;
  }
  Status status = stop ? absl::OkStatus() : Take(std::move(messages));
  v1::StreamReadingsResponse response;
  if (ingest_ != nullptr) {
    const auto safe = static_cast<uint64_t>(ingest_->SafeBatches());
    const bool received = spec_.acknowledge_received && status.ok();
    acknowledged_ = received   ? last_sequence_
                    : safe > 0 ? std::max(acknowledged_, first_sequence_ + safe - 1)
                               : acknowledged_;
    response.set_acknowledged(acknowledged_);
    response.set_committed_steps(static_cast<uint64_t>(ingest_->committed_steps()));
    *response.mutable_counts() = wire::ToProto(ingest_->counts());
  }
  if (status.ok() && complete && !stop && ingest_ != nullptr && ingest_->counts().pending > 0) {
    status = FailedPrecondition(
        "the messages ended without a batch that is the `last`, so that {} readings of open steps "
        "are dropped; send them again, and batch.last behind them",
        ingest_->counts().pending);
  }
  const bool close = stop || complete || !status.ok();
  const bool has_response = ingest_ != nullptr && !stop;
  if (close) {
    Close();
  }
  {
    const std::lock_guard lock(mutex_);
    working_ = false;
    closed_ = close;
    if (has_response) {
      response_ = std::move(response);
      has_response_ = answered_ = true;
    }
    if (end_.ok()) {
      end_ = status;
    }
  }
  Act();
}

/// Sorts in what came and commits what that closes.
Status LiveStream::Take(std::vector<v1::StreamReadingsRequest> messages) {
  for (const v1::StreamReadingsRequest& message : messages) {
    FOVEA_RETURN_IF_ERROR(ingest_ == nullptr ? Open(message) : AddBatch(message));
  }
  if (ingest_ == nullptr) {
    return absl::OkStatus();  // nothing came at all
  }
  const int64_t before = ingest_->committed_steps();
  FOVEA_RETURN_IF_ERROR(ingest_->Publish());
  if (ingest_->committed_steps() != before || last_sequence_ == 0) {
    services_.steps.Poke(spec_.dataset);
  }
  return absl::OkStatus();
}

Status LiveStream::Open(const v1::StreamReadingsRequest& first) {
  if (!first.has_header()) {
    return wire::BadField("header", "is missing: the first message says where readings go");
  }
  FOVEA_ASSIGN_OR_RETURN(spec_, wire::FromProto(first.header()));
  if (!caller_->Sees(spec_.dataset)) {
    return NoDataset(spec_.dataset);
  }
  FOVEA_ASSIGN_OR_RETURN(ingest_, LiveIngest::Open(*services_.catalogue, spec_));
  services_.steps.Subscribe(spec_.dataset, weak_from_this());  // for when the server drains
  return ReserveMemory();
}

Status LiveStream::AddBatch(const v1::StreamReadingsRequest& message) {
  if (!message.has_batch()) {
    return message.has_header()
               ? wire::BadField("header", "came twice: only the first message has one")
               : wire::BadField("batch", "is missing: the message is empty");
  }
  if (last_came_) {
    return wire::BadField("batch.last", "was said of the batch before");
  }
  FOVEA_ASSIGN_OR_RETURN(const wire::ReadingBatch batch,
                         wire::FromProto(message.batch(), ingest_->fields()));
  if (last_sequence_ != 0 && batch.sequence != last_sequence_ + 1) {
    return wire::BadField("batch.sequence", fmt::format("{} came after {}: they go up by 1",
                                                        batch.sequence, last_sequence_));
  }
  FOVEA_RETURN_IF_ERROR(ingest_->Add(batch));
  first_sequence_ = first_sequence_ == 0 ? batch.sequence : first_sequence_;
  last_sequence_ = batch.sequence;
  last_came_ = batch.last;
  return ReserveMemory();
}

/// As much as the readings of open steps take, in blocks.
Status LiveStream::ReserveMemory() {
  const int64_t bytes = ingest_->counts().pending * (48 + 8 * ingest_->fields());
  const auto blocks = static_cast<size_t>(1 + (bytes + kMemoryBlock - 1) / kMemoryBlock);
  while (memory_.size() > blocks) {
    memory_.pop_back();
  }
  while (memory_.size() < blocks) {
    auto block = services_.requests.Reserve(kMemoryBlock);
    FOVEA_RETURN_IF_ERROR(Annotate(block.status(), "readings that wait for their steps to close"));
    memory_.push_back(*std::move(block));
  }
  return absl::OkStatus();
}

void LiveStream::Close() {
  const bool was_open = ingest_ != nullptr;
  ingest_.reset();
  memory_.clear();
  if (was_open) {
    services_.steps.Poke(spec_.dataset);  // it may be gone again
  }
}

}  // namespace fovea::server
