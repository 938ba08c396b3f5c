#include "ingest/worker/slab_sender.h"

namespace fovea::ingest {

Status SlabSender::Start(const DenseStart& start) {
  return channel_->Send(Encode(start), Channel::kNoDeadline);
}

StatusOr<std::span<std::byte>> SlabSender::Next() {
  FOVEA_RETURN_IF_ERROR(WaitFor(slab_));
  return channel_->slabs()->Slab(slab_);
}

Status SlabSender::Send(int64_t rows) {
  is_full_[slab_] = true;
  FOVEA_RETURN_IF_ERROR(channel_->Send(Encode(SlabRows{slab_, rows}), Channel::kNoDeadline));
  slab_ = (slab_ + 1) % kSlabs;
  return channel_->Flush(Channel::kNoDeadline);
}

Status SlabSender::Finish(const FieldEnd& end) {
  for (uint32_t slab = 0; slab < kSlabs; ++slab) {
    FOVEA_RETURN_IF_ERROR(WaitFor(slab));
  }
  return channel_->Send(Encode(end), Channel::kNoDeadline);
}

Status SlabSender::WaitFor(uint32_t slab) {
  while (is_full_[slab]) {
    FOVEA_ASSIGN_OR_RETURN(const FrameView reply, channel_->Receive(Channel::kNoDeadline));
    FOVEA_ASSIGN_OR_RETURN(const uint32_t free, DecodeSlabFree(reply));
    is_full_[free] = false;
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
