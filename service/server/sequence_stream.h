#ifndef SERVICE_SERVER_SEQUENCE_STREAM_H_
#define SERVICE_SERVER_SEQUENCE_STREAM_H_

#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "engine/base/status.h"
#include "engine/base/stopwatch.h"
#include "fovea/v1/render.pb.h"
#include "service/access/gate.h"
#include "service/frames/animation.h"
#include "service/server/frame_job.h"
#include "service/server/sequence_pacer.h"
#include "service/server/services.h"
#include "service/server/stream_registry.h"
#include "service/wire/requests.h"

namespace fovea::server {

/// Where the frames of a stream go. Called from any thread, never twice at a time for writes.
class FrameSink {
 public:
  virtual ~FrameSink() = default;
  /// `frame` stays as it is until the stream is told of the end of the write.
  virtual void Write(const v1::Frame& frame) = 0;
  /// Once; nothing is called after it.
  virtual void Finish(const Status& status) = 0;
};

/// One RenderSequence: carries out in the pools what its SequencePacer decides. Knows no gRPC, so
/// that a thread sanitizer can follow all of it. A job of it may outlast the call: share it.
/// Thread-safe.
class SequenceStream final : public AcknowledgedStream,
                             public StepListener,
                             public std::enable_shared_from_this<SequenceStream> {
 public:
  /// `sink` must live until its Finish is called. Use std::make_shared.
  SequenceStream(Services& services, FrameSink& sink, uint32_t window)
      : services_(services),
        sink_(sink),
        counters_(services.metrics.OfMethod("/fovea.v1.Render/RenderSequence")),
        pacer_(window) {}

  /// Starts the stream for `caller`, or ends it with what is wrong with `request`, or why it was
  /// not let in. Call once, and first.
  void Start(StatusOr<wire::SequenceRequest> request, std::shared_ptr<access::Caller> caller,
             const std::string& client = "");
  void OnWriteDone(bool ok);
  void OnCancel();
  Status Acknowledge(uint64_t index) override;
  /// Of the dataset that it follows.
  void OnNews(const DatasetNews& news) override;

 private:
  [[nodiscard]] Status Admit(StatusOr<wire::SequenceRequest> request);
  void Open();
  [[nodiscard]] Status Prepare();
  [[nodiscard]] Status PreparePath(int64_t committed_steps);
  /// The frame of this index: job_, or what the path shows there. Reads no disk.
  [[nodiscard]] StatusOr<FrameJob> JobOf(int64_t index) const;
  [[nodiscard]] int64_t StepOf(int64_t index) const;
  [[nodiscard]] int64_t FrameCount() const { return path_ ? path_->frames() : series_.count; }
  void Render(const FrameJob& job, int64_t index, int threads);

  /// Tells the pacer of an event and does what it says.
  void Handle(const std::function<SequencePacer::Actions(SequencePacer&)>& event);
  void Act(SequencePacer::Actions actions);
  void SubmitRender(int64_t index);
  /// Under the mutex.
  [[nodiscard]] Status Submit(FrameJob job, int64_t index);
  /// Room for replies as large as this job's. Under the mutex.
  [[nodiscard]] Status Reserve(const FrameJob& job);
  void End(const Status& status);

  Services& services_;
  FrameSink& sink_;
  Metrics::Method& counters_;
  std::string client_;  // whose turn its work takes (ClientOf); not changed after Start
  std::shared_ptr<access::Caller> caller_;  // not changed after Start; null if it was not let in
  wire::SequenceRequest request_;           // not changed after Start
  bool registered_ = false;                 // not changed after Start
  // Written by Prepare, before the first frame is asked for.
  FrameJob job_;  // of a path: of its first frame
  wire::StepSeries series_;
  std::optional<frames::Animation> path_;
  frames::FrameSpec path_spec_;  // what of it the path does not say

  std::mutex mutex_;
  // All below: guarded by mutex_.
  SequencePacer pacer_;
  MemoryBudget::Reservation reservation_;
  int64_t reserved_bytes_ = 0;
  v1::Frame ready_;    // rendered, not written yet
  v1::Frame writing_;  // the sink's while a write is in flight
  WorkPool::Ticket ticket_ = 0;
  Stopwatch asked_;        // since the frame that is rendered was asked for
  Stopwatch ready_asked_;  // since `ready_` was
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SEQUENCE_STREAM_H_
