#ifndef SERVICE_SERVER_SEQUENCE_STREAM_H_
#define SERVICE_SERVER_SEQUENCE_STREAM_H_

#include <functional>
#include <memory>
#include <mutex>

#include <grpcpp/support/server_callback.h>

#include "engine/base/status.h"
#include "engine/base/stopwatch.h"
#include "fovea/v1/render.pb.h"
#include "service/server/frame_job.h"
#include "service/server/sequence_pacer.h"
#include "service/server/services.h"
#include "service/server/stream_registry.h"
#include "service/wire/requests.h"

namespace fovea::server {

/// One RenderSequence: carries out in the pools and on the wire what its SequencePacer decides.
/// Lives until gRPC and every job have let go of it, since a job may outlast the call. Thread-safe.
class SequenceStream final : public grpc::ServerWriteReactor<v1::Frame>,
                             public AcknowledgedStream,
                             public std::enable_shared_from_this<SequenceStream> {
 public:
  /// Starts a stream, or ends it at once with what is wrong. Hand `get()` to gRPC.
  [[nodiscard]] static std::shared_ptr<SequenceStream> Start(
      Services& services, const v1::RenderSequenceRequest& request);

  Status Acknowledge(uint64_t index) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  struct Private {};

 public:
  SequenceStream(Private, Services& services, uint32_t window)
      : services_(services), pacer_(window) {}

 private:
  [[nodiscard]] Status Admit(StatusOr<wire::SequenceRequest> request);
  void Open();
  [[nodiscard]] Status Prepare();
  void Render(int64_t index, int threads);

  /// Tells the pacer of an event and does what it says.
  void Handle(const std::function<SequencePacer::Actions(SequencePacer&)>& event);
  void Act(SequencePacer::Actions actions);
  void SubmitRender(int64_t index);
  void End(const Status& status);

  Services& services_;
  const Stopwatch watch_;
  std::shared_ptr<SequenceStream> self_;  // set before gRPC knows of it, reset when gRPC is done
  CallTracker::Slot slot_;
  wire::SequenceRequest request_;  // not changed after Start
  bool registered_ = false;        // not changed after Start
  // Written by Prepare, before the first frame is asked for.
  FrameJob job_;
  wire::StepSeries series_;
  MemoryBudget::Reservation reservation_;

  std::mutex mutex_;
  // All below: guarded by mutex_.
  SequencePacer pacer_;
  v1::Frame ready_;    // rendered, not written yet
  v1::Frame writing_;  // gRPC's while a write is in flight
  WorkPool::Ticket ticket_ = 0;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SEQUENCE_STREAM_H_
