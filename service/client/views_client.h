#ifndef SERVICE_CLIENT_VIEWS_CLIENT_H_
#define SERVICE_CLIENT_VIEWS_CLIENT_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "engine/base/status.h"
#include "service/client/client.h"
#include "service/frames/spec.h"

/// Pictures that sharpen and views that move, in plain structs: callers need neither gRPC nor
/// Protobuf. docs/service.md says how the two methods are meant to be used.
namespace fovea::client {

/// A frame of RefineFrame or Explore. As RenderFrame gives it; its `used` has the rate.
struct ViewFrame {
  frames::Frame frame;
  uint64_t view_id = 0;  // Explore: View::id
  bool final = false;    // at the rate that was asked for
};

struct RefineRequest {
  std::string dataset;
  int64_t step = 0;
  frames::FrameSpec spec;
  double first_frame_ms = 15;  // that the first frame should take on the server, 1 to 10000
};

/// All of a view: what `spec` leaves out is the dataset's default, whatever views came before.
struct View {
  std::string dataset;
  int64_t step = 0;
  bool latest = false;  // instead: the last step committed when the view is drawn
  frames::FrameSpec spec;
  uint64_t id = 0;      // comes back in the frames
  bool moving = false;  // another will follow soon: one frame, within the budget
  double frame_budget_ms =
      30;  // of a frame while it moves, and of the first one at rest, 1 to 10000
};

/// Called for each frame, in order; false ends the call, which is OK then.
using OnViewFrame = std::function<bool(const ViewFrame&)>;

/// One Explore. It must not outlive its client. Show and Finish may be called from any thread, also
/// while frames come; they are called one at a time, from a thread of this.
class Exploration {
 public:
  /// Cancels what is left of the call, and waits for the frame in hand to be taken.
  virtual ~Exploration() = default;
  /// The newest view wins. An error is how the call has ended: it cannot be gone on with; but
  /// INVALID_ARGUMENT for a view that is not sent.
  [[nodiscard]] virtual Status Show(const View& view) = 0;
  /// No view will follow: waits until the last one is drawn in full, or OnViewFrame says no. How
  /// the call ended.
  [[nodiscard]] virtual Status Finish() = 0;
};

/// One connection, made by the first call. Errors are the server's, with "server HOST:PORT: " in
/// front. What comes back is checked: INTERNAL if it cannot be what the proto promises.
/// Thread-safe.
class ViewsClient {
 public:
  /// As Client::Connect. `deadline_seconds` bounds each wait for the next frame of Refine.
  [[nodiscard]] static StatusOr<std::unique_ptr<ViewsClient>> Connect(
      const std::string& address, const Credentials& credentials = {},
      double deadline_seconds = 60);
  virtual ~ViewsClient() = default;

  /// The picture at a low rate first and at higher ones after it; the last one is final.
  [[nodiscard]] virtual Status Refine(const RefineRequest& request,
                                      const OnViewFrame& on_frame) = 0;
  /// At most `window` frames (1 to 64) are ahead of those that `on_frame` has returned from; 0: as
  /// many as the transport takes.
  [[nodiscard]] virtual std::unique_ptr<Exploration> Explore(OnViewFrame on_frame,
                                                             uint32_t window = 2) = 0;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_VIEWS_CLIENT_H_
