#ifndef SERVICE_SERVER_LIVE_STREAM_H_
#define SERVICE_SERVER_LIVE_STREAM_H_

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "engine/base/status.h"
#include "fovea/v1/ingest.pb.h"
#include "service/access/gate.h"
#include "service/server/live_ingest.h"
#include "service/server/services.h"
#include "service/server/step_feed.h"

namespace fovea::server {

/// The client of a StreamReadings. Called from any thread; no two reads or writes are under way at
/// a time.
class ReadingsPeer {
 public:
  virtual ~ReadingsPeer() = default;
  /// Asks for the next message; OnMessage or OnReadsDone follows.
  virtual void Read() = 0;
  /// `response` stays as it is until OnWriteDone.
  virtual void Write(const v1::StreamReadingsResponse& response) = 0;
  /// Once; nothing is called after it.
  virtual void Finish(const Status& status) = 0;
};

/// One StreamReadings: reads ahead of a LiveIngest, which works in the ingest pool, and
/// acknowledges.
///
/// * While kMostWaitingBytes wait, nothing is read: the client's transport holds it back. Nor while
///   the caller is above its quota of bytes in; it is told so, once a second.
/// * One job at a time sorts in all that waits and commits what that closes, together; so steps
///   that come faster than they can be committed share a commit.
/// * What is acknowledged is safe: the acknowledgement is made after the commit.
/// * An error, a cancel or a draining server drop what is open and was not acknowledged. The store
///   is let go of before the client hears of the end.
///
/// Knows no gRPC. A job of it may outlast the call: share it. Thread-safe.
class LiveStream final : public StepListener, public std::enable_shared_from_this<LiveStream> {
 public:
  static constexpr int64_t kMostWaitingBytes = int64_t{2} << 20;
  /// Streams of one server that write at once.
  static constexpr int kMostStreams = 64;

  /// `peer` must live until its Finish is called. Use std::make_shared.
  LiveStream(Services& services, ReadingsPeer& peer) : services_(services), peer_(peer) {}

  /// Begins to read for `caller`, or ends with why it was not let in. Call once, and first.
  void Start(const Status& admitted, std::shared_ptr<access::Caller> caller);
  void OnMessage(v1::StreamReadingsRequest message);
  /// The client will send nothing more, or is gone.
  void OnReadsDone();
  void OnWriteDone(bool ok);
  void OnCancel();
  void OnNews(const DatasetNews& news) override;

 private:
  /// What to do next, with mutex_ held; done without.
  struct Actions {
    bool read = false, work = false, write = false;
    std::optional<Status> finish;
  };
  [[nodiscard]] Actions Decide();
  void Act();
  /// Reads nothing for so long, or looks again once a second: a token may be taken away.
  /// With mutex_ held.
  void HoldBack(std::chrono::milliseconds wait);
  void LookAgain();
  void Stop(const Status& status);
  [[nodiscard]] bool Stopping() const { return !end_.ok() || cancelled_; }

  void Work();
  [[nodiscard]] Status Take(std::vector<v1::StreamReadingsRequest> messages);
  [[nodiscard]] Status Open(const v1::StreamReadingsRequest& first);
  [[nodiscard]] Status AddBatch(const v1::StreamReadingsRequest& message);
  [[nodiscard]] Status ReserveMemory();
  void Close();

  Services& services_;
  ReadingsPeer& peer_;
  std::shared_ptr<access::Caller> caller_;  // not changed after Start
  // The working job's own; there is one at a time.
  std::unique_ptr<LiveIngest> ingest_;
  wire::ReadingsSpec spec_;
  uint64_t first_sequence_ = 0, last_sequence_ = 0;  // 0: no batch yet
  uint64_t acknowledged_ = 0;
  bool last_came_ = false;
  std::vector<MemoryBudget::Reservation> memory_;  // what it works with, and its open steps

  std::mutex mutex_;
  // All below: guarded by mutex_.
  std::vector<v1::StreamReadingsRequest> waiting_;
  int64_t waiting_bytes_ = 0;
  v1::StreamReadingsResponse response_;  // the newest
  v1::StreamReadingsResponse writing_response_;
  std::chrono::milliseconds held_{0};  // above 0: nothing is read, for the quota
  bool answered_ = false;              // once; response_ is one
  Status end_;                         // why it stops; OK: not yet, or all is done
  bool counted_ = false;               // among services_.live_streams
  bool opened_ = false, closed_ = false;
  bool reading_ = false, reads_done_ = false, working_ = false, writing_ = false;
  bool starting_read_ = false;  // peer_ is being asked: it must not hear of the end meanwhile
  bool has_response_ = false, cancelled_ = false, finished_ = false;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_LIVE_STREAM_H_
