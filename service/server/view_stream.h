#ifndef SERVICE_SERVER_VIEW_STREAM_H_
#define SERVICE_SERVER_VIEW_STREAM_H_

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "engine/base/status.h"
#include "engine/base/stopwatch.h"
#include "fovea/v1/render.pb.h"
#include "service/access/gate.h"
#include "service/server/frame_job.h"
#include "service/server/rate_chooser.h"
#include "service/server/sequence_stream.h"
#include "service/server/services.h"
#include "service/server/view_pacer.h"
#include "service/wire/view_request.h"

namespace fovea::server {

/// One Explore or RefineFrame: carries out in the pools what its ViewPacer decides. Knows no gRPC.
/// A job of it may outlast the call: share it. Thread-safe.
class ViewStream final : public std::enable_shared_from_this<ViewStream> {
 public:
  /// `sink` must live until its Finish is called. Use std::make_shared.
  ViewStream(Services& services, FrameSink& sink, const char* method)
      : services_(services),
        sink_(sink),
        counters_(services.metrics.OfMethod(std::string("/fovea.v1.Render/") + method)) {}

  /// Call once, and first: on whose behalf, or why it is not let in.
  void Start(StatusOr<std::shared_ptr<access::Caller>> caller, const std::string& client = "");
  void OnView(wire::ViewRequest view);
  /// One at a time. How long the next one must not be read, for the caller's quota of bytes in.
  [[nodiscard]] std::chrono::milliseconds OnExploreRequest(const v1::ExploreRequest& request);
  void OnError(const Status& error);
  void OnNoMoreViews();
  void OnWriteDone(bool ok);
  void OnCancel();

 private:
  /// A view whose frames can be rendered.
  struct OpenView {
    wire::ViewRequest request;
    FrameJob job;  // at the rate that was asked for
    int64_t step = 0;
    RateChooser::View cost;
    double part = 0;  // of the rate, of the frame rendered last; 0: none
  };

  [[nodiscard]] StatusOr<OpenView> Prepare(const wire::ViewRequest& request);
  void Open();
  void Render(int threads);
  void SubmitRender();
  /// Tells the pacer of an event and does what it says.
  void Handle(const std::function<ViewPacer::Actions(ViewPacer&)>& event);
  void Act(ViewPacer::Actions actions);
  void End(const Status& status);

  Services& services_;
  FrameSink& sink_;
  Metrics::Method& counters_;
  std::string client_;  // whose turn its work takes (ClientOf); not changed after Start
  std::shared_ptr<access::Caller> caller_;  // not changed after Start
  wire::ExploreRequests requests_;          // OnExploreRequest's

  std::mutex mutex_;
  // All below: guarded by mutex_.
  ViewPacer pacer_;
  wire::ViewRequest newest_;
  std::shared_ptr<OpenView> opened_;  // a rendering keeps the one that it began with
  MemoryBudget::Reservation reservation_;
  int64_t reserved_bytes_ = 0;
  RateChooser chooser_;
  bool admitted_ = false;  // a frame of this stream was let into the render queue
  v1::Frame ready_;        // rendered, not written yet
  v1::Frame writing_;      // the sink's while a write is in flight
  WorkPool::Ticket ticket_ = 0;
  Stopwatch asked_;        // since the frame that is rendered was asked for
  Stopwatch ready_asked_;  // since `ready_` was
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_VIEW_STREAM_H_
