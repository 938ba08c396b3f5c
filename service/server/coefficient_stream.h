#ifndef SERVICE_SERVER_COEFFICIENT_STREAM_H_
#define SERVICE_SERVER_COEFFICIENT_STREAM_H_

#include <functional>
#include <memory>
#include <mutex>

#include "engine/base/status.h"
#include "fovea/v1/coefficients.pb.h"
#include "service/access/gate.h"
#include "service/server/coefficient_job.h"
#include "service/server/sequence_pacer.h"
#include "service/server/services.h"
#include "service/wire/coefficients.h"

namespace fovea::server {

/// Where the blocks of a stream go. Called from any thread, never twice at a time for writes.
class BlockSink {
 public:
  virtual ~BlockSink() = default;
  /// `block` stays as it is until the stream is told of the end of the write.
  virtual void Write(const v1::CoefficientBlock& block) = 0;
  /// Once; nothing is called after it.
  virtual void Finish(const Status& status) = 0;
};

/// One StreamCoefficients: carries out in the pools what its SequencePacer decides, so that at most
/// one block is being made, one waits and one is being written. Knows no gRPC. A job of it may
/// outlast the call: share it. Thread-safe.
class CoefficientStream final : public std::enable_shared_from_this<CoefficientStream> {
 public:
  /// `sink` must live until its Finish is called. Use std::make_shared.
  CoefficientStream(Services& services, BlockSink& sink)
      : services_(services), sink_(sink), pacer_(/*window=*/0) {}

  /// Starts the stream for `caller`, or ends it with what is wrong with `request`, or why it was
  /// not let in. Call once, and first.
  void Start(StatusOr<wire::CoefficientsRequest> request, std::shared_ptr<access::Caller> caller,
             const std::string& client = "");
  void OnWriteDone(bool ok);
  void OnCancel();

 private:
  [[nodiscard]] Status Enqueue(StatusOr<wire::CoefficientsRequest> request);
  void Open();
  [[nodiscard]] Status Prepare();
  void Make(int64_t index);

  /// Tells the pacer of an event and does what it says.
  void Handle(const std::function<SequencePacer::Actions(SequencePacer&)>& event);
  void SubmitMake(int64_t index);
  void End(const Status& status);
  [[nodiscard]] bool over();

  Services& services_;
  BlockSink& sink_;
  std::string client_;  // whose turn its work takes (ClientOf); not changed after Start
  std::shared_ptr<access::Caller> caller_;  // not changed after Start; null if it was not let in
  wire::CoefficientsRequest request_;       // not changed after Start
  // Written by Prepare; then used by one Make at a time.
  std::unique_ptr<CoefficientJob> job_;
  MemoryBudget::Reservation reservation_;

  std::mutex mutex_;
  // All below: guarded by mutex_.
  SequencePacer pacer_;
  v1::CoefficientBlock ready_;    // made, not written yet
  v1::CoefficientBlock writing_;  // the sink's while a write is in flight
  WorkPool::Ticket ticket_ = 0;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_COEFFICIENT_STREAM_H_
