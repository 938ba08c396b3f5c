#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "engine/base/stopwatch.h"
#include "service/client/reading_sender_impl.h"
#include "service/wire/readings.h"
#include "service/wire/status.h"

namespace fovea::client {
namespace {

/// How a call ends that can go on in another: the server was away, restarts, or has a limit that is
/// not reached for ever.
bool IsPassing(const Status& status) {
  return absl::IsUnavailable(status) || wire::RetryDelayOf(status).has_value();
}

/// Or it has not heard yet that the call before is over, and holds the dataset.
bool MayResume(const Status& status) {
  return IsPassing(status) || absl::IsFailedPrecondition(status);
}

void Add(const sensors::ReadingCounts& more, sensors::ReadingCounts* counts) {
  counts->read += more.read - more.pending;  // what was pending is sent again
  counts->used += more.used;
  counts->duplicates += more.duplicates;
  counts->not_finite += more.not_finite;
  counts->out_of_range += more.out_of_range;
  counts->outside += more.outside;
  counts->late += more.late;
  counts->ahead += more.ahead;
  counts->empty_windows += more.empty_windows;
}

}  // namespace

GrpcReadingSender::GrpcReadingSender(v1::Ingest::Stub& stub, Prepare prepare,
                                     const ReadingsSpec& spec, double deadline_seconds,
                                     OnHeld on_held)
    : stub_(stub),
      prepare_(std::move(prepare)),
      deadline_seconds_(deadline_seconds),
      on_held_(std::move(on_held)),
      fields_(std::max<int>(1, static_cast<int>(spec.fields.size()))) {
  *header_.mutable_header() = wire::ToProto(spec);
}

StatusOr<std::unique_ptr<ReadingSender>> GrpcReadingSender::Open(v1::Ingest::Stub& stub,
                                                                 Prepare prepare,
                                                                 const ReadingsSpec& spec,
                                                                 double deadline_seconds,
                                                                 OnHeld on_held) {
  auto sender = std::unique_ptr<GrpcReadingSender>(
      new GrpcReadingSender(stub, std::move(prepare), spec, deadline_seconds, std::move(on_held)));
  FOVEA_RETURN_IF_ERROR(sender->StartCall());
  return sender;
}

Status GrpcReadingSender::StartCall() {
  call_ = std::make_unique<ReadingCall>(stub_, prepare_, on_held_);
  written_ = 0;
  static_cast<void>(call_->Write(header_));  // how the call ended says why not
  return call_->WaitForAnswer(deadline_seconds_).status();
}

Status GrpcReadingSender::Send(std::span<const sensors::Reading> readings,
                               std::span<const float> values) {
  const auto fields = static_cast<size_t>(fields_);
  if (values.size() != readings.size() * fields) {
    return InvalidArgument("{} values for {} readings of {} fields", values.size(), readings.size(),
                           fields_);
  }
  const auto most = static_cast<size_t>(wire::ReadingsOfOneMessage(fields_));
  for (size_t first = 0; first < readings.size(); first += most) {
    const size_t count = std::min(most, readings.size() - first);
    wire::ReadingBatch batch;
    const auto part = readings.subspan(first, count);
    batch.readings.assign(part.begin(), part.end());
    const auto numbers = values.subspan(first * fields, count * fields);
    batch.values.assign(numbers.begin(), numbers.end());
    FOVEA_RETURN_IF_ERROR(SendBatch(std::move(batch)));
  }
  return absl::OkStatus();
}

Status GrpcReadingSender::SendBatch(wire::ReadingBatch batch) {
  batch.sequence = ++sequence_;
  *unacknowledged_.emplace_back().mutable_batch() = wire::ToProto(batch);
  report_.batches = sequence_;
  TakeAnswer();
  return SendWaiting() ? absl::OkStatus() : Resume(call_->Finish());
}

/// False if the call broke.
bool GrpcReadingSender::SendWaiting() {
  for (; written_ < unacknowledged_.size(); ++written_) {
    if (!call_->Write(unacknowledged_[written_])) {
      return false;
    }
  }
  return true;
}

/// Lets go of what is safe.
void GrpcReadingSender::TakeAnswer() {
  const v1::StreamReadingsResponse answer = call_->latest();
  while (!unacknowledged_.empty() &&
         unacknowledged_.front().batch().sequence() <= answer.acknowledged()) {
    unacknowledged_.pop_front();
    written_ -= std::min<size_t>(written_, 1);
    fruitless_ = 0;
  }
  report_.acknowledged = std::max<uint64_t>(report_.acknowledged, answer.acknowledged());
  report_.committed_steps =
      std::max(report_.committed_steps, static_cast<int64_t>(answer.committed_steps()));
}

Status GrpcReadingSender::Resume(Status why) {
  TakeAnswer();
  if (!IsPassing(why)) {
    return why.ok() ? Internal("the server ended the call before the readings ended") : why;
  }
  if (absl::IsResourceExhausted(why) && ++fruitless_ > kMostFruitless) {
    return Annotate(why, fmt::format("tried {} times, and no batch became safe", fruitless_));
  }
  const Stopwatch away;
  std::chrono::milliseconds pause{100};
  while (MayResume(why) && away.ElapsedMs() < kAwaySeconds * 1000) {
    Add(wire::FromProto(call_->latest().counts()), &counts_before_);
    std::this_thread::sleep_for(pause);
    pause = std::min(2 * pause, std::chrono::milliseconds(2000));
    why = StartCall();
    if (why.ok()) {
      ++report_.resumed;
      if (SendWaiting()) {
        return absl::OkStatus();
      }
      why = call_->Finish();
      TakeAnswer();
    }
  }
  return why;
}

Status GrpcReadingSender::Finish() {
  wire::ReadingBatch last;
  last.last = true;
  FOVEA_RETURN_IF_ERROR(SendBatch(std::move(last)));
  while (true) {
    const Status end = call_->Finish();
    TakeAnswer();
    if (end.ok() && unacknowledged_.empty()) {
      return absl::OkStatus();
    }
    FOVEA_RETURN_IF_ERROR(Resume(end));
  }
}

SendingReport GrpcReadingSender::report() const {
  SendingReport report = report_;
  report.counts = counts_before_;
  const sensors::ReadingCounts now = wire::FromProto(call_->latest().counts());
  Add(now, &report.counts);
  report.counts.read += now.pending;
  report.counts.pending = now.pending;
  return report;
}

}  // namespace fovea::client
