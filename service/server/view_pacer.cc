#include "service/server/view_pacer.h"

#include <algorithm>
#include <utility>

#include "service/wire/status.h"

namespace fovea::server {

ViewPacer::Actions ViewPacer::OnView() {
  ++newest_;
  return Advance();
}

ViewPacer::Actions ViewPacer::OnNoMoreViews() {
  closed_ = true;
  return Advance();
}

ViewPacer::Actions ViewPacer::OnOpened(Status outcome, bool moving) {
  opening_ = false;
  if (!outcome.ok()) {
    return OnError(std::move(outcome));
  }
  opened_ = opening_of_;
  moving_ = moving;
  drawn_ = 0;
  drawn_last_ = false;
  return Advance();
}

ViewPacer::Actions ViewPacer::OnRendered(Status outcome, bool is_last, bool* keep) {
  const int64_t of = std::exchange(rendering_of_, 0);
  *keep = false;
  if (!outcome.ok()) {
    return OnError(std::move(outcome));
  }
  if (of == opened_) {
    ++drawn_;
    drawn_last_ = is_last;
  }
  *keep = of == newest_ || rendering_first_;
  ready_of_ = *keep ? of : ready_of_;
  return Advance();
}

ViewPacer::Actions ViewPacer::OnWriteDone(bool ok) {
  writing_ = false;
  cancelled_ = cancelled_ || !ok;
  return Advance();
}

ViewPacer::Actions ViewPacer::OnError(Status error) {
  if (error_.ok()) {
    error_ = std::move(error);
  }
  return Advance();
}

ViewPacer::Actions ViewPacer::OnCancelled() {
  cancelled_ = true;
  return Advance();
}

StatusOr<ViewPacer::Actions> ViewPacer::OnAcknowledged(uint64_t index) {
  if (index >= sent_) {
    return wire::BadField(
        "acknowledged", fmt::format("{} is not sent yet: the frames before {} are", index, sent_));
  }
  acknowledged_ = std::max(acknowledged_, index + 1);
  return Advance();
}

ViewPacer::Actions ViewPacer::Finish(Status status) {
  finished_ = true;
  Actions actions;
  actions.finish = std::move(status);
  return actions;
}

bool ViewPacer::IsDrawn() const {
  return moving_ ? drawn_ > 0 : drawn_last_;
}

ViewPacer::Actions ViewPacer::Advance() {
  Actions actions;
  if (finished_) {
    return actions;
  }
  if (cancelled_ || !error_.ok()) {
    return writing_ ? actions
                    : Finish(cancelled_ ? Cancelled("the client cancelled, went away, or its "
                                                    "deadline passed")
                                        : error_);
  }
  if (ready_of_ != 0 && !writing_ && (window_ == 0 || sent_ - acknowledged_ < window_)) {
    ready_of_ = 0;
    writing_ = true;
    ++sent_;
    actions.write = true;
  }
  if (!opening_ && newest_ > opened_) {
    opening_ = true;
    actions.open = true;
  }
  // A frame that waits for the client holds up sharper ones of its view, but not a newer view.
  if (rendering_of_ == 0 && opened_ > 0 && !IsDrawn() && ready_of_ != opened_ &&
      (drawn_ == 0 || newest_ == opened_)) {
    BeginRender();
    actions.render = true;
  }
  const bool is_idle = rendering_of_ == 0 && ready_of_ == 0 && !writing_ && !opening_;
  if (closed_ && is_idle && newest_ == opened_ && (newest_ == 0 || IsDrawn())) {
    return Finish(absl::OkStatus());
  }
  return actions;
}

}  // namespace fovea::server
