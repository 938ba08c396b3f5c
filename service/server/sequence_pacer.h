#ifndef SERVICE_SERVER_SEQUENCE_PACER_H_
#define SERVICE_SERVER_SEQUENCE_PACER_H_

#include <cstdint>
#include <deque>
#include <optional>

#include "engine/base/status.h"

namespace fovea::server {

/// Decides what a stream of frames does next; does nothing itself and knows no gRPC.
///
/// 1. A stream is opened (the dataset looked up, the spec resolved) before it renders.
/// 2. At most one frame is being rendered, one waits to be written, and one is being written.
/// 3. With a window W > 0, at most W frames are rendered ahead of the acknowledgements.
/// 4. An error ends the stream after the frames before it were written.
/// 5. A cancel ends it at once; only a write in flight is waited for. What is being rendered then
///    is thrown away when it arrives.
/// 6. One that follows has no end. Frames that there were when it was opened are sent one by one;
///    of those that come later always the newest one.
/// 7. Exactly one call returns `finish`, and none returns anything after it.
///
/// Every event returns what to do now; the caller must do all of it. Not thread-safe: the owner
/// calls it under a mutex, and carries out the actions without.
class SequencePacer {
 public:
  struct Actions {
    std::optional<int64_t> render;  // render the frame of this index, then call OnRendered
    bool write = false;             // write the frame last passed to OnRendered, then OnWriteDone
    std::optional<Status> finish;   // end the stream with this status
  };

  explicit SequencePacer(uint32_t window) : window_(window) {}

  /// The stream will send the frames `first_index` to `end_index` - 1.
  Actions OnOpened(int64_t first_index, int64_t end_index);
  /// The same, and then those that OnGrown tells of.
  Actions OnOpenedToFollow(int64_t first_index, int64_t end_index);
  /// There are frames up to `end_index` - 1 now. Only if it follows.
  Actions OnGrown(int64_t end_index);
  /// There will be no more: ends after what is under way, with this error.
  Actions OnBroken(Status error);
  /// Opening failed.
  Actions OnOpenFailed(Status error);
  /// The frame asked for is ready, or could not be made.
  Actions OnRendered(Status outcome);
  /// `ok` is false if the client is gone.
  Actions OnWriteDone(bool ok);
  /// Every frame up to `index` was shown. INVALID_ARGUMENT if that one was not sent yet; repeated
  /// and late ones do nothing.
  StatusOr<Actions> OnAcknowledged(uint64_t index);
  Actions OnCancelled();

  /// Whether nothing that is rendered now will be sent.
  [[nodiscard]] bool over() const { return cancelled_ || finished_; }

 private:
  Actions Advance();
  Actions Finish(Status status);
  [[nodiscard]] bool WindowIsOpen() const {
    return window_ == 0 || unacknowledged_.size() < window_;
  }

  const uint32_t window_;
  int64_t next_ = 0;  // the next frame to render
  int64_t end_ = 0;
  bool follow_ = false;
  int64_t follow_from_ = 0;  // frames from this one on may be skipped
  int64_t ready_index_ = 0;  // of the frame being rendered, or ready
  int64_t sent_ = 0;         // frames before this one were handed to the transport, or skipped
  std::deque<int64_t> unacknowledged_;  // asked for and not known to be shown, ascending
  bool opening_ = true;
  bool rendering_ = false, ready_ = false, writing_ = false;
  bool cancelled_ = false, finished_ = false;
  Status error_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SEQUENCE_PACER_H_
