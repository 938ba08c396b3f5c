#ifndef INGEST_WORKER_SLAB_SENDER_H_
#define INGEST_WORKER_SLAB_SENDER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// Sends one dense field through the slabs that the program shares.
class SlabSender {
 public:
  /// `channel` has slabs, and outlives the sender.
  explicit SlabSender(Channel* channel) : channel_(channel) {}

  /// Announces the field.
  [[nodiscard]] Status Start(const DenseStart& start);
  /// A slab to fill with whole rows, at least one; waits until the program has emptied it.
  [[nodiscard]] StatusOr<std::span<std::byte>> Next();
  /// Sends the first `rows` rows of it.
  [[nodiscard]] Status Send(int64_t rows);
  /// Waits until all slabs are empty, so that nothing but the next request is to come, and ends the
  /// field.
  [[nodiscard]] Status Finish(const FieldEnd& end);

 private:
  [[nodiscard]] Status WaitFor(uint32_t slab);

  Channel* channel_;
  uint32_t slab_ = 0;
  std::array<bool, kSlabs> is_full_{};
};

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_SLAB_SENDER_H_
