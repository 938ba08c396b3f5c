#ifndef INGEST_CHANNEL_H_
#define INGEST_CHANNEL_H_

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>

#include "engine/base/status.h"
#include "ingest/protocol.h"
#include "ingest/slab_ring.h"

namespace fovea::ingest {

/// Frames over one end of a stream socket. Not thread-safe.
class Channel {
 public:
  using Deadline = std::chrono::steady_clock::time_point;
  static constexpr Deadline kNoDeadline = Deadline::max();

  /// Takes the socket over and closes it in the end.
  explicit Channel(int socket) : socket_(socket) {}
  ~Channel();
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  /// Queues a frame; it leaves with Flush or when enough has gathered. UNAVAILABLE if the other end
  /// is gone, DEADLINE_EXCEEDED if it does not take it in time.
  [[nodiscard]] Status Send(const Frame& frame, Deadline deadline);
  [[nodiscard]] Status Flush(Deadline deadline);

  /// The next frame. UNAVAILABLE if the other end is gone, DEADLINE_EXCEEDED if nothing came in
  /// time, INTERNAL if it announces more than kMaxPayloadBytes. Valid until the next Receive.
  [[nodiscard]] StatusOr<FrameView> Receive(Deadline deadline);

  /// Memory that the two ends share beside the socket; null if none was attached.
  void Attach(std::unique_ptr<SlabRing> slabs) { slabs_ = std::move(slabs); }
  [[nodiscard]] SlabRing* slabs() const { return slabs_.get(); }

 private:
  [[nodiscard]] Status Wait(short events, Deadline deadline) const;
  /// Makes `size` bytes from `consumed_` on be there, side by side.
  [[nodiscard]] Status Gather(size_t size, Deadline deadline);

  int socket_;
  std::string outgoing_;
  std::unique_ptr<char[]> incoming_;  // not a vector: nothing is to be zeroed
  size_t capacity_ = 0;               // of incoming_
  size_t received_ = 0;               // bytes of it that came
  size_t consumed_ = 0;               // of these, that were given out
  std::unique_ptr<SlabRing> slabs_;
};

}  // namespace fovea::ingest

#endif  // INGEST_CHANNEL_H_
