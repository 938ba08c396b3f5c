#ifndef SERVICE_SERVER_VIEW_PACER_H_
#define SERVICE_SERVER_VIEW_PACER_H_

#include <cstdint>
#include <optional>

#include "engine/base/status.h"

namespace fovea::server {

/// Decides what an Explore (or a RefineFrame, an Explore of one view) does next; does nothing
/// itself and knows no gRPC. Views are counted from 1 as they come.
///
/// 1. A view is opened (its dataset looked up, its spec resolved) before it is drawn; only the
///    newest is.
/// 2. At most one frame is being rendered, one waits to be written, and one is being written. A
///    frame that waits gives way to one of a newer view.
/// 3. A moving view is drawn once. One at rest is drawn sharper and sharper, up to the last.
/// 4. The first frame of a view is sent also if a newer view has come since: it is the newest
///    picture that there is. Sharper ones are thrown away then.
/// 5. With a window W > 0, a frame is written once fewer than W before it are not acknowledged.
/// 6. An error ends the stream after the frame in flight; a cancel at once. Exactly one call
///    returns `finish`, and none returns anything after it.
///
/// Every event returns what to do now; the caller must do all of it. Not thread-safe.
class ViewPacer {
 public:
  struct Actions {
    bool open = false;             // open the newest view, then OnOpened
    bool render = false;           // render the view opened last, a rung higher, then OnRendered
    bool write = false;            // write the frame last passed to OnRendered, then OnWriteDone
    std::optional<Status> finish;  // end the stream with this status
  };

  /// A new view. `window` as of now.
  Actions OnView();
  /// No view will come any more.
  Actions OnNoMoreViews();
  /// What `open` and `render` asked for begins only now: with the newest view, or the one opened
  /// last, as of this moment.
  void BeginOpen() { opening_of_ = newest_; }
  void BeginRender() {
    rendering_of_ = opened_;
    rendering_first_ = drawn_ == 0;
  }
  /// The view that was the newest at BeginOpen.
  Actions OnOpened(Status outcome, bool moving);
  /// `is_last`: at the rate that was asked for. `*keep`: whether the frame is to be kept.
  Actions OnRendered(Status outcome, bool is_last, bool* keep);
  Actions OnWriteDone(bool ok);  // false: the client is gone
  Actions OnError(Status error);
  Actions OnCancelled();
  void SetWindow(uint32_t window) { window_ = window; }
  /// INVALID_ARGUMENT if the frame was not sent yet.
  StatusOr<Actions> OnAcknowledged(uint64_t index);

  /// Whether nothing that is rendered now will be sent.
  [[nodiscard]] bool over() const { return cancelled_ || finished_; }
  /// The index of the next frame that is written.
  [[nodiscard]] uint64_t next_index() const { return sent_; }

 private:
  Actions Advance();
  Actions Finish(Status status);
  [[nodiscard]] bool IsDrawn() const;

  uint32_t window_ = 0;
  int64_t newest_ = 0, opened_ = 0;  // views; 0: none
  bool moving_ = false;              // the one that is opened
  int64_t drawn_ = 0;                // frames of it that were rendered
  bool drawn_last_ = false;          // at the rate that was asked for
  int64_t rendering_of_ = 0;         // 0: nothing is rendered
  bool rendering_first_ = false;     // the first frame of its view
  int64_t ready_of_ = 0;             // likewise
  bool opening_ = false, writing_ = false;
  int64_t opening_of_ = 0;
  bool closed_ = false, cancelled_ = false, finished_ = false;
  uint64_t sent_ = 0, acknowledged_ = 0;  // frames
  Status error_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_VIEW_PACER_H_
