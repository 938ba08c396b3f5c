#include "service/server/coefficient_stream.h"

#include <utility>

namespace fovea::server {
namespace {

/// A block that is ready, one being written, the bytes that gRPC makes of that one, and the first
/// message's summary.
constexpr int64_t kHeldBytes = 4 * static_cast<int64_t>(coefficients::kMaxBlockBytes);

}  // namespace

void CoefficientStream::Start(StatusOr<wire::CoefficientsRequest> request,
                              std::shared_ptr<access::Caller> caller, const std::string& client) {
  client_ = client;
  caller_ = std::move(caller);
  if (const Status status = Enqueue(std::move(request)); !status.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnOpenFailed(status); });
  }
}

Status CoefficientStream::Enqueue(StatusOr<wire::CoefficientsRequest> request) {
  FOVEA_RETURN_IF_ERROR(request.status());
  request_ = *std::move(request);
  return services_.lookups
      .Submit(
          0, [self = shared_from_this()](int) { self->Open(); }, client_)
      .status();
}

bool CoefficientStream::over() {
  const std::lock_guard lock(mutex_);
  return pacer_.over();
}

void CoefficientStream::Open() {
  if (over()) {
    return;
  }
  const Status status = Prepare();
  Handle([&](SequencePacer& pacer) {
    return status.ok() ? pacer.OnOpened(job_->first(), job_->end()) : pacer.OnOpenFailed(status);
  });
}

Status CoefficientStream::Prepare() {
  FOVEA_ASSIGN_OR_RETURN(job_, CoefficientJob::Prepare(*services_.catalogue, request_));
  FOVEA_ASSIGN_OR_RETURN(
      reservation_,
      services_.replies.Reserve(kHeldBytes + CoefficientJob::WorkingBytes() + job_->PlanBytes()));
  return absl::OkStatus();
}

void CoefficientStream::Make(int64_t index) {
  if (over()) {
    return;
  }
  // A coefficient is about as much work as a pixel.
  Status status = caller_->TakePixels(job_->CoefficientsIn(index));
  v1::CoefficientBlock block;
  if (status.ok()) {
    auto message = job_->Make(index);
    status = message.status();
    if (message.ok()) {
      block = wire::ToProto(*std::move(message));
    }
  }
  Handle([&](SequencePacer& pacer) {
    if (status.ok()) {
      ready_ = std::move(block);
    }
    return pacer.OnRendered(status);
  });
}

void CoefficientStream::Handle(const std::function<SequencePacer::Actions(SequencePacer&)>& event) {
  SequencePacer::Actions actions;
  {
    const std::lock_guard lock(mutex_);
    actions = event(pacer_);
    if (actions.write) {
      writing_ = std::move(ready_);
    }
  }
  if (actions.render) {
    SubmitMake(*actions.render);
  }
  if (actions.write) {
    sink_.Write(writing_);
  }
  if (actions.finish) {
    End(*actions.finish);
  }
}

void CoefficientStream::SubmitMake(int64_t index) {
  auto job = [self = shared_from_this(), index](int /*threads*/) { self->Make(index); };
  Status refused;
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
    // Only the first block of a stream asks to be let in.
    if (index == job_->first()) {
      const auto ticket =
          services_.renders.Submit(CoefficientJob::WorkingBytes(), std::move(job), client_);
      ticket_ = ticket.ok() ? *ticket : 0;
      refused = ticket.status();
    } else {
      ticket_ =
          services_.renders.SubmitAdmitted(CoefficientJob::WorkingBytes(), std::move(job), client_);
    }
  }
  if (!refused.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnRendered(refused); });
  }
}

void CoefficientStream::End(const Status& status) {
  sink_.Finish(services_.catalogue->WithoutRoot(status));
}

void CoefficientStream::OnWriteDone(bool ok) {
  Handle([ok](SequencePacer& pacer) { return pacer.OnWriteDone(ok); });
}

void CoefficientStream::OnCancel() {
  WorkPool::Ticket ticket = 0;
  Handle([&](SequencePacer& pacer) {
    ticket = ticket_;
    return pacer.OnCancelled();
  });
  services_.renders.Remove(ticket);
}

}  // namespace fovea::server
