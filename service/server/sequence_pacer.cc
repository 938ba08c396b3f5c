#include "service/server/sequence_pacer.h"

#include <algorithm>
#include <utility>

#include "service/wire/status.h"

namespace fovea::server {

SequencePacer::Actions SequencePacer::OnOpened(int64_t first_index, int64_t end_index) {
  opening_ = false;
  next_ = sent_ = first_index;
  end_ = end_index;
  return Advance();
}

SequencePacer::Actions SequencePacer::OnOpenedToFollow(int64_t first_index, int64_t end_index) {
  follow_ = true;
  follow_from_ = end_index;
  return OnOpened(first_index, end_index);
}

SequencePacer::Actions SequencePacer::OnGrown(int64_t end_index) {
  end_ = std::max(end_, end_index);
  return Advance();
}

SequencePacer::Actions SequencePacer::OnBroken(Status error) {
  if (error_.ok()) {
    error_ = std::move(error);
  }
  return Advance();
}

SequencePacer::Actions SequencePacer::OnOpenFailed(Status error) {
  opening_ = false;
  error_ = std::move(error);
  return Advance();
}

SequencePacer::Actions SequencePacer::OnRendered(Status outcome) {
  rendering_ = false;
  ready_ = outcome.ok();
  if (error_.ok()) {
    error_ = std::move(outcome);
  }
  return Advance();
}

SequencePacer::Actions SequencePacer::OnWriteDone(bool ok) {
  writing_ = false;
  cancelled_ = cancelled_ || !ok;
  return Advance();
}

StatusOr<SequencePacer::Actions> SequencePacer::OnAcknowledged(uint64_t index) {
  if (index >= static_cast<uint64_t>(sent_)) {
    return wire::BadField(
        "index", fmt::format("{} is not sent yet: the frames before {} are", index, sent_));
  }
  while (!unacknowledged_.empty() && unacknowledged_.front() <= static_cast<int64_t>(index)) {
    unacknowledged_.pop_front();
  }
  return Advance();
}

SequencePacer::Actions SequencePacer::OnCancelled() {
  cancelled_ = true;
  return Advance();
}

SequencePacer::Actions SequencePacer::Finish(Status status) {
  finished_ = true;
  Actions actions;
  actions.finish = std::move(status);
  return actions;
}

SequencePacer::Actions SequencePacer::Advance() {
  Actions actions;
  if (finished_) {
    return actions;
  }
  if (cancelled_) {
    return writing_ ? actions
                    : Finish(Cancelled("the client cancelled, went away, or its deadline "
                                       "passed"));
  }
  if (opening_) {
    return actions;
  }
  if (ready_ && !writing_) {
    ready_ = false;
    writing_ = true;
    sent_ = ready_index_ + 1;
    actions.write = true;
  }
  if (!rendering_ && !ready_ && error_.ok() && next_ < end_ && WindowIsOpen()) {
    rendering_ = true;
    if (next_ >= follow_from_ && follow_) {
      next_ = end_ - 1;
    }
    if (window_ > 0) {
      unacknowledged_.push_back(next_);
    }
    ready_index_ = next_;
    actions.render = next_++;
  }
  const bool complete = next_ >= end_ && !follow_;
  if (!rendering_ && !ready_ && !writing_ && (!error_.ok() || complete)) {
    return Finish(error_);
  }
  return actions;
}

}  // namespace fovea::server
