#ifndef SERVICE_SERVER_UPLOAD_STREAM_H_
#define SERVICE_SERVER_UPLOAD_STREAM_H_

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "engine/base/status.h"
#include "fovea/v1/ingest.pb.h"
#include "ingest/step_upload.h"
#include "service/access/gate.h"
#include "service/server/services.h"
#include "service/server/step_feed.h"
#include "service/wire/upload_spec.h"

namespace fovea::server {

/// The client of an UploadStep. Called from any thread; no two reads are under way at a time.
class UploadPeer {
 public:
  virtual ~UploadPeer() = default;
  /// Asks for the next message; OnMessage or OnReadsDone follows.
  virtual void Read() = 0;
  /// Once; nothing is called after it. `response` is of a call that is OK.
  virtual void Finish(const Status& status, const v1::UploadStepResponse& response) = 0;
};

/// One UploadStep: reads ahead of an ingest::StepUpload, which works in the ingest pool.
///
/// * While kMostWaitingBytes wait, or the token's quota of bytes is used up, nothing is read: the
///   client's transport holds it back.
/// * The step is committed when its last byte is there, whatever the client does then; the answer
///   comes after the commit.
/// * An error, a cancel, a draining server, or a client that sends nothing for kMostIdle, drop the
///   step. Memory and the store are let go of before the client hears of the end.
///
/// Knows no gRPC. A job of it may outlast the call: share it. Thread-safe.
class UploadStream final : public StepListener, public std::enable_shared_from_this<UploadStream> {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr int64_t kMostWaitingBytes = int64_t{2} << 20;
  static constexpr std::chrono::seconds kMostIdle{30};
  static constexpr std::chrono::milliseconds kTick{500};

  /// `peer` must live until its Finish is called. Use std::make_shared.
  UploadStream(Services& services, UploadPeer& peer) : services_(services), peer_(peer) {}

  /// Begins to read for `caller`, or ends with why it was not let in. Call once, and first.
  void Start(const Status& admitted, std::shared_ptr<access::Caller> caller);
  void OnMessage(v1::UploadStepRequest message);
  /// The client will send nothing more, or is gone.
  void OnReadsDone();
  void OnCancel();
  void OnNews(const DatasetNews& news) override;
  /// To be called every kTick: ends the call of a client that has been silent for too long, and
  /// goes on with one that was held back. False if the call is over.
  bool OnTick(Clock::time_point now);

 private:
  struct Actions {
    bool read = false, work = false;
    std::optional<Status> finish;
  };
  [[nodiscard]] Actions Decide();
  void Act();
  void Stop(const Status& status);

  void Work();
  [[nodiscard]] Status Take(const std::vector<v1::UploadStepRequest>& messages);
  [[nodiscard]] Status Open(const v1::UploadStepRequest& first);
  [[nodiscard]] Status AddPiece(const v1::UploadStepRequest& message);

  Services& services_;
  UploadPeer& peer_;
  std::shared_ptr<access::Caller> caller_;  // not changed after Start
  // The working job's own; there is one at a time.
  std::unique_ptr<ingest::StepUpload> upload_;
  wire::UploadSpec spec_;
  std::vector<MemoryBudget::Reservation> memory_;

  std::mutex mutex_;
  // All below: guarded by mutex_.
  std::vector<v1::UploadStepRequest> waiting_;
  int64_t waiting_bytes_ = 0;
  Clock::time_point read_since_;               // the read under way
  std::optional<v1::UploadStepRequest> held_;  // what came above the quota; no read is under way
  v1::UploadStepResponse response_;
  std::optional<Status> end_;  // how it ends
  bool counted_ = false;       // among services_.live_streams
  bool opened_ = false;        // a job of it ran
  bool reading_ = false, reads_done_ = false, working_ = false, closed_ = false;
  bool starting_read_ = false;  // peer_ is being asked: it must not hear of the end meanwhile
  bool finished_ = false;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_UPLOAD_STREAM_H_
