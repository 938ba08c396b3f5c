#include "service/server/sequence_stream.h"

#include <utility>

namespace fovea::server {
namespace {

/// A frame that is ready, one being written, and the bytes that are made of that one.
constexpr int64_t kFramesHeld = 3;

}  // namespace

void SequenceStream::Start(StatusOr<wire::SequenceRequest> request,
                           std::shared_ptr<access::Caller> caller, const std::string& client) {
  client_ = client;
  caller_ = std::move(caller);
  if (const Status status = Admit(std::move(request)); !status.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnOpenFailed(status); });
  }
}

Status SequenceStream::Admit(StatusOr<wire::SequenceRequest> request) {
  FOVEA_RETURN_IF_ERROR(request.status());
  request_ = *std::move(request);
  if (!request_.stream_id.empty()) {
    FOVEA_RETURN_IF_ERROR(
        services_.streams.Add(caller_->name(), request_.stream_id, weak_from_this()));
    registered_ = true;
  }
  return services_.lookups
      .Submit(
          0, [self = shared_from_this()](int) { self->Open(); }, client_)
      .status();
}

void SequenceStream::Open() {
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
  }
  const Status status = Prepare();
  const auto first = static_cast<int64_t>(request_.start_index);
  Handle([&](SequencePacer& pacer) {
    return !status.ok()      ? pacer.OnOpenFailed(status)
           : request_.follow ? pacer.OnOpenedToFollow(first, series_.count)
                             : pacer.OnOpened(first, series_.count);
  });
  if (status.ok() && request_.follow) {
    services_.steps.Subscribe(request_.dataset, weak_from_this());
  }
}

void SequenceStream::OnNews(const DatasetNews& news) {
  const bool same = news.dataset == job_.dataset;
  Handle([&](SequencePacer& pacer) {
    return news.closing ? pacer.OnBroken(DrainingError())
           : same       ? pacer.OnGrown(series_.CountAt(news.committed_steps))
                        : pacer.OnBroken(NotFound(
                              "dataset '{}' was removed or replaced; call again for what is there now",
                              request_.dataset));
  });
}

Status SequenceStream::Prepare() {
  FOVEA_ASSIGN_OR_RETURN(job_, PrepareFrame(*services_.catalogue, request_.dataset, request_.spec));
  const int64_t committed = job_.dataset->dataset().info().committed_steps;
  FOVEA_ASSIGN_OR_RETURN(series_, wire::ResolveSteps(request_, committed));
  FOVEA_ASSIGN_OR_RETURN(reservation_, services_.replies.Reserve(kFramesHeld * job_.reply_bytes));
  return absl::OkStatus();
}

void SequenceStream::Render(int64_t index, int threads) {
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
  }
  if (const Status allowed = caller_->TakePixels(job_.pixels); !allowed.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnRendered(allowed); });
    return;
  }
  auto frame = RenderJob(job_, series_.StepAt(index), static_cast<uint64_t>(index), threads);
  services_.frames_rendered.fetch_add(1, std::memory_order_relaxed);
  Handle([&](SequencePacer& pacer) {
    if (frame.ok()) {
      ready_ = *std::move(frame);
      ready_asked_ = asked_;
    }
    return pacer.OnRendered(frame.status());
  });
}

void SequenceStream::Handle(const std::function<SequencePacer::Actions(SequencePacer&)>& event) {
  SequencePacer::Actions actions;
  {
    const std::lock_guard lock(mutex_);
    actions = event(pacer_);
    if (actions.write) {
      writing_ = std::move(ready_);
      counters_.FrameAged(ready_asked_.ElapsedMs() / 1e3);
    }
  }
  Act(std::move(actions));
}

void SequenceStream::Act(SequencePacer::Actions actions) {
  if (actions.render) {
    SubmitRender(*actions.render);
  }
  if (actions.write) {
    sink_.Write(writing_);
  }
  if (actions.finish) {
    End(*actions.finish);
  }
}

void SequenceStream::SubmitRender(int64_t index) {
  auto job = [self = shared_from_this(), index](int threads) { self->Render(index, threads); };
  Status refused;
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
    asked_ = Stopwatch();
    // Only the first frame of a stream asks to be let in.
    if (index == static_cast<int64_t>(request_.start_index)) {
      const auto ticket = services_.renders.Submit(job_.render_bytes, std::move(job), client_);
      ticket_ = ticket.ok() ? *ticket : 0;
      refused = ticket.status();
    } else {
      ticket_ = services_.renders.SubmitAdmitted(job_.render_bytes, std::move(job), client_);
    }
  }
  if (!refused.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnRendered(refused); });
  }
}

void SequenceStream::End(const Status& status) {
  if (registered_) {
    services_.streams.Remove(caller_->name(), request_.stream_id);
  }
  sink_.Finish(services_.catalogue->WithoutRoot(status));
}

Status SequenceStream::Acknowledge(uint64_t index) {
  Status status;
  Handle([&](SequencePacer& pacer) {
    auto actions = pacer.OnAcknowledged(index);
    status = actions.status();
    return actions.ok() ? *actions : SequencePacer::Actions();
  });
  return status;
}

void SequenceStream::OnWriteDone(bool ok) {
  Handle([ok](SequencePacer& pacer) { return pacer.OnWriteDone(ok); });
}

void SequenceStream::OnCancel() {
  WorkPool::Ticket ticket = 0;
  Handle([&](SequencePacer& pacer) {
    ticket = ticket_;
    return pacer.OnCancelled();
  });
  services_.renders.Remove(ticket);
}

}  // namespace fovea::server
