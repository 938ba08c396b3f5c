#include "service/server/view_stream.h"

#include <algorithm>
#include <utility>

#include "service/frames/frames.h"

namespace fovea::server {
namespace {

/// A frame that is ready, one being written, and the bytes that are made of that one.
constexpr int64_t kFramesHeld = 3;

}  // namespace

void ViewStream::Start(StatusOr<std::shared_ptr<access::Caller>> caller,
                       const std::string& client) {
  client_ = client;
  if (caller.ok()) {
    caller_ = *std::move(caller);
  } else {
    OnError(caller.status());
  }
}

std::chrono::milliseconds ViewStream::OnExploreRequest(const v1::ExploreRequest& request) {
  if (caller_ == nullptr) {
    return {};  // not let in: over already
  }
  auto change = requests_.Add(request);
  if (!change.ok()) {
    OnError(change.status());
    return {};
  }
  // An acknowledgement alone is free: a quota must not stall it.
  const auto wait =
      caller_->SpendBytesIn(change->view ? static_cast<int64_t>(request.ByteSizeLong()) : 0);
  if (!wait.ok()) {
    OnError(wait.status());
    return {};
  }
  if (change->window || change->acknowledged) {
    Status status;
    Handle([&](ViewPacer& pacer) -> ViewPacer::Actions {
      if (change->window) {
        pacer.SetWindow(*change->window);
      }
      if (!change->acknowledged) {
        return {};
      }
      auto actions = pacer.OnAcknowledged(*change->acknowledged);
      return actions.ok() ? *std::move(actions) : pacer.OnError(actions.status());
    });
  }
  if (change->view) {
    OnView(*std::move(change->view));
    return *wait;
  }
  return {};
}

void ViewStream::OnView(wire::ViewRequest view) {
  if (caller_ == nullptr) {
    return;  // not let in: over already
  }
  if (!caller_->Sees(view.dataset)) {
    OnError(NoDataset(view.dataset));
    return;
  }
  Handle([&](ViewPacer& pacer) {
    newest_ = std::move(view);
    return pacer.OnView();
  });
}

void ViewStream::OnError(const Status& error) {
  Handle([&](ViewPacer& pacer) { return pacer.OnError(error); });
}

void ViewStream::OnNoMoreViews() {
  Handle([](ViewPacer& pacer) { return pacer.OnNoMoreViews(); });
}

void ViewStream::OnWriteDone(bool ok) {
  Handle([ok](ViewPacer& pacer) { return pacer.OnWriteDone(ok); });
}

void ViewStream::OnCancel() {
  WorkPool::Ticket ticket = 0;
  Handle([&](ViewPacer& pacer) {
    ticket = ticket_;
    return pacer.OnCancelled();
  });
  services_.renders.Remove(ticket);
}

StatusOr<ViewStream::OpenView> ViewStream::Prepare(const wire::ViewRequest& request) {
  OpenView view;
  view.request = request;
  FOVEA_ASSIGN_OR_RETURN(view.job,
                         PrepareFrame(*services_.catalogue, request.dataset, request.spec));
  store::Dataset& dataset = view.job.dataset->dataset();
  const int64_t committed = dataset.info().committed_steps;  // PrepareFrame: at least one
  const uint64_t step = request.latest ? static_cast<uint64_t>(committed) - 1 : request.step;
  FOVEA_ASSIGN_OR_RETURN(view.step, ChooseStep(request.dataset, dataset, step, request.time_ns));
  view.cost = {dataset.info().hierarchy, frames::FoveaOf(view.job.spec), view.job.pixels};
  return view;
}

void ViewStream::Open() {
  wire::ViewRequest request;
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
    pacer_.BeginOpen();
    request = newest_;
  }
  auto view = Prepare(request);
  Handle([&](ViewPacer& pacer) {
    Status status = view.status();
    const int64_t bytes = view.ok() ? kFramesHeld * view->job.reply_bytes : 0;
    if (bytes > reserved_bytes_) {
      auto more = services_.replies.Reserve(bytes);
      status = more.status();
      if (more.ok()) {
        reservation_ = *std::move(more);
        reserved_bytes_ = bytes;
      }
    }
    if (status.ok()) {
      opened_ = std::make_shared<OpenView>(*std::move(view));
    }
    return pacer.OnOpened(std::move(status), request.moving);
  });
}

void ViewStream::Render(int threads) {
  std::shared_ptr<OpenView> view;
  FrameJob job;
  double part = 0;
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
    pacer_.BeginRender();
    view = opened_;
    part = view->part > 0 ? chooser_.Next(view->part, view->cost)
                          : chooser_.Within(view->request.budget_ms, view->cost);
    view->part = part;
  }
  job = view->job;
  job.spec.rate = RateChooser::RateOf(part, view->cost);
  const Stopwatch watch;
  const Status allowed = caller_->TakePixels(job.pixels);
  StatusOr<v1::Frame> frame =
      allowed.ok() ? RenderJob(job, view->step, 0, threads) : StatusOr<v1::Frame>(allowed);
  services_.frames_rendered.fetch_add(1, std::memory_order_relaxed);
  const double took_ms = watch.ElapsedMs();
  Handle([&](ViewPacer& pacer) {
    chooser_.Learn(part, view->cost, took_ms);
    bool keep = false;
    auto actions = pacer.OnRendered(frame.status(), part >= 1, &keep);
    if (keep) {
      ready_ = *std::move(frame);
      ready_asked_ = asked_;
      ready_.set_view_id(view->request.view_id);
      ready_.set_final(part >= 1);
    }
    return actions;
  });
}

void ViewStream::Handle(const std::function<ViewPacer::Actions(ViewPacer&)>& event) {
  ViewPacer::Actions actions;
  {
    const std::lock_guard lock(mutex_);
    const uint64_t index = pacer_.next_index();
    actions = event(pacer_);
    if (actions.write) {
      writing_ = std::move(ready_);
      writing_.set_index(index);
      counters_.FrameAged(ready_asked_.ElapsedMs() / 1e3);
    }
  }
  Act(std::move(actions));
}

void ViewStream::Act(ViewPacer::Actions actions) {
  if (actions.open) {
    const auto ticket = services_.lookups.Submit(
        0, [self = shared_from_this()](int) { self->Open(); }, client_);
    if (!ticket.ok()) {
      Handle([&](ViewPacer& pacer) { return pacer.OnOpened(ticket.status(), false); });
    }
  }
  if (actions.render) {
    SubmitRender();
  }
  if (actions.write) {
    sink_.Write(writing_);
  }
  if (actions.finish) {
    End(*actions.finish);
  }
}

void ViewStream::SubmitRender() {
  auto job = [self = shared_from_this()](int threads) { self->Render(threads); };
  Status refused;
  {
    const std::lock_guard lock(mutex_);
    if (pacer_.over()) {
      return;
    }
    asked_ = Stopwatch();
    const int64_t bytes = opened_->job.render_bytes;
    if (admitted_) {  // only the first frame of a stream asks to be let in
      ticket_ = services_.renders.SubmitAdmitted(bytes, std::move(job), client_);
    } else {
      const auto ticket = services_.renders.Submit(bytes, std::move(job), client_);
      admitted_ = ticket.ok();
      ticket_ = ticket.ok() ? *ticket : 0;
      refused = ticket.status();
    }
  }
  if (!refused.ok()) {
    OnError(refused);
  }
}

void ViewStream::End(const Status& status) {
  sink_.Finish(services_.catalogue->WithoutRoot(status));
}

}  // namespace fovea::server
