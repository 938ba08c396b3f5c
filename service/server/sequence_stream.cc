#include "service/server/sequence_stream.h"

#include <algorithm>
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
                             : pacer.OnOpened(first, FrameCount());
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
  if (request_.path) {
    FOVEA_RETURN_IF_ERROR(PreparePath(committed));
  }
  const std::lock_guard lock(mutex_);
  return Reserve(job_);
}

Status SequenceStream::PreparePath(int64_t committed_steps) {
  FOVEA_ASSIGN_OR_RETURN(path_, wire::ResolvePath(request_, series_, committed_steps));
  // All else that would be looked up is in job_.spec, which JobOf falls back on.
  path_spec_ = request_.spec;
  path_spec_.color_transfer = job_.spec.color_transfer;
  for (size_t i = 0; i < path_->keys().size(); ++i) {
    const int64_t frame = std::min(path_->keys()[i].frame, path_->frames() - 1);
    FOVEA_RETURN_IF_ERROR(wire::PointAtKeyframe(JobOf(frame).status(), *path_, i));
  }
  FOVEA_ASSIGN_OR_RETURN(job_, JobOf(0));
  return absl::OkStatus();
}

StatusOr<FrameJob> SequenceStream::JobOf(int64_t index) const {
  return path_ ? PrepareFrame(job_.dataset, path_->SpecAt(index, path_spec_), job_.spec) : job_;
}

int64_t SequenceStream::StepOf(int64_t index) const {
  if (!path_) {
    return series_.StepAt(index);
  }
  return path_->StepAt(index).value_or(series_.StepAt(path_->PlaceIn(series_.count, index)));
}

Status SequenceStream::Reserve(const FrameJob& job) {
  const int64_t bytes = kFramesHeld * job.reply_bytes;
  if (bytes > reserved_bytes_) {
    FOVEA_ASSIGN_OR_RETURN(reservation_, services_.replies.Reserve(bytes));
    reserved_bytes_ = bytes;
  }
  return absl::OkStatus();
}

void SequenceStream::Render(const FrameJob& job, int64_t index, int threads) {
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
  }
  if (const Status allowed = caller_->TakePixels(job.pixels); !allowed.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnRendered(allowed); });
    return;
  }
  auto frame = RenderJob(job, StepOf(index), static_cast<uint64_t>(index), threads);
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
  auto job = JobOf(index);
  Status refused = job.status();
  if (refused.ok()) {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
    refused = Reserve(*job);
    if (refused.ok()) {
      refused = Submit(*std::move(job), index);
    }
  }
  if (!refused.ok()) {
    Handle([&](SequencePacer& pacer) { return pacer.OnRendered(refused); });
  }
}

Status SequenceStream::Submit(FrameJob job, int64_t index) {
  const int64_t bytes = job.render_bytes;
  auto work = [self = shared_from_this(), index, job = std::move(job)](int threads) {
    self->Render(job, index, threads);
  };
  asked_ = Stopwatch();
  // Only the first frame of a stream asks to be let in.
  if (index != static_cast<int64_t>(request_.start_index)) {
    ticket_ = services_.renders.SubmitAdmitted(bytes, std::move(work), client_);
    return absl::OkStatus();
  }
  const auto ticket = services_.renders.Submit(bytes, std::move(work), client_);
  ticket_ = ticket.ok() ? *ticket : 0;
  return ticket.status();
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
