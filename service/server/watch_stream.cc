#include "service/server/watch_stream.h"

#include <algorithm>
#include <string>
#include <utility>

namespace fovea::server {

void WatchStream::Start(StatusOr<wire::WatchRequest> request,
                        std::shared_ptr<access::Caller> caller) {
  caller_ = std::move(caller);
  if (!request.ok()) {
    End(request.status());
    return;
  }
  request_ = *std::move(request);
  {
    const std::lock_guard lock(mutex_);
    next_ = request_.first_step;
  }
  services_.steps.Subscribe(request_.dataset, weak_from_this());
}

void WatchStream::OnNews(const DatasetNews& news) {
  Status error;
  {
    const std::lock_guard lock(mutex_);
    if (news.closing) {
      error = DrainingError();
    } else if (!news_ && news.dataset == nullptr && !request_.wait) {
      error = news.error;
    }
    news_ = news;
  }
  if (error.ok()) {
    Advance();
  } else {
    End(std::move(error));
  }
}

bool WatchStream::HasNews() const {
  return news_ &&
         (!told_ || *told_ != news_->dataset ||
          (news_->dataset != nullptr && next_ < static_cast<uint64_t>(news_->committed_steps)));
}

void WatchStream::Advance() {
  {
    const std::lock_guard lock(mutex_);
    if (finished_ || building_ || writing_ || end_ || !HasNews()) {
      return;
    }
    building_ = true;
  }
  // Times are read from the disk.
  services_.lookups.SubmitAdmitted(0, [self = shared_from_this()](int) { self->Build(); });
}

void WatchStream::Build() {
  DatasetNews news;
  int64_t first = 0;
  bool replaced = false;
  {
    const std::lock_guard lock(mutex_);
    news = *news_;
    replaced = told_ && *told_ != nullptr && *told_ != news.dataset;
    if (replaced) {
      news = DatasetNews();  // first that the one it knows is gone
    }
    if (told_ && *told_ == nullptr && news.dataset != nullptr) {
      next_ = 0;
    }
    first = static_cast<int64_t>(std::min(next_, static_cast<uint64_t>(news.committed_steps)));
  }
  v1::DatasetEvent event;
  event.set_state(news.dataset != nullptr ? v1::DatasetEvent::PRESENT : v1::DatasetEvent::ABSENT);
  event.set_committed_steps(static_cast<uint64_t>(news.committed_steps));
  Status status = caller_->TakeBytesIn(0);  // a token may have been taken away
  if (status.ok() && news.dataset != nullptr) {
    status = AddSteps(news, first, &event);
    if (!status.ok() && IsGone(news)) {
      Forget(news);
      return;
    }
  }
  bool write = false;
  {
    const std::lock_guard lock(mutex_);
    building_ = false;
    write = status.ok() && !end_;
    if (write) {
      told_ = news.dataset;
      next_ += static_cast<uint64_t>(event.steps_size());
      event_ = std::move(event);
      writing_ = true;
    }
  }
  if (write) {
    sink_.Write(event_);
  } else {
    End(std::move(status));
  }
}

/// Whether the disk holds something else by now: the feed will say so, if it has not yet.
bool WatchStream::IsGone(const DatasetNews& news) const {
  const auto now = services_.catalogue->FindNow(request_.dataset);
  return !now.ok() || *now != news.dataset;
}

void WatchStream::Forget(const DatasetNews& news) {
  bool told_already = false;
  {
    const std::lock_guard lock(mutex_);
    building_ = false;
    told_already = news_->dataset != news.dataset;
  }
  if (told_already) {
    Advance();
  }
  End(absl::OkStatus());
}

Status WatchStream::AddSteps(const DatasetNews& news, int64_t first, v1::DatasetEvent* event) {
  store::Dataset& dataset = news.dataset->dataset();
  const int64_t end = std::min(news.committed_steps, first + kMaxStepsPerEvent);
  for (int64_t step = first; step < end; ++step) {
    const auto time_ns = dataset.TimeNs(step);
    FOVEA_RETURN_IF_ERROR(time_ns.status());
    const auto frame_number = dataset.FrameNumber(step);
    FOVEA_RETURN_IF_ERROR(frame_number.status());
    v1::DatasetEvent::Step* told = event->add_steps();
    told->set_step(static_cast<uint64_t>(step));
    told->set_time_ns(*time_ns);
    if (*frame_number) {
      told->set_frame_number(**frame_number);
    }
  }
  return absl::OkStatus();
}

void WatchStream::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    writing_ = false;
  }
  if (ok) {
    Advance();
    End(absl::OkStatus());
  } else {
    OnCancel();
  }
}

void WatchStream::OnCancel() {
  End(Cancelled("the client cancelled, went away, or its deadline passed"));
}

/// Ends the stream with the first error that it gets, once nothing is under way.
void WatchStream::End(Status status) {
  {
    const std::lock_guard lock(mutex_);
    if (!status.ok() && !end_) {
      end_ = std::move(status);
    }
    if (finished_ || !end_ || building_ || writing_) {
      return;
    }
    finished_ = true;
    status = *end_;
  }
  sink_.Finish(services_.catalogue->WithoutRoot(status));
}

}  // namespace fovea::server
