#include "service/server/sequence_pacer.h"

#include <algorithm>
#include <utility>

#include "service/wire/status.h"

namespace fovea::server {

SequencePacer::Actions SequencePacer::OnOpened(int64_t first_index, int64_t end_index) {
  opening_ = false;
  next_ = sent_ = acknowledged_ = first_index;
  end_ = end_index;
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
  error_ = std::move(outcome);
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
  acknowledged_ = std::max(acknowledged_, static_cast<int64_t>(index) + 1);
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
    ++sent_;
    actions.write = true;
  }
  if (!rendering_ && !ready_ && error_.ok() && next_ < end_ && WindowIsOpen()) {
    rendering_ = true;
    actions.render = next_++;
  }
  if (!rendering_ && !ready_ && !writing_ && (!error_.ok() || next_ == end_)) {
    return Finish(error_);
  }
  return actions;
}

}  // namespace fovea::server
