#ifndef SERVICE_SERVER_WATCH_STREAM_H_
#define SERVICE_SERVER_WATCH_STREAM_H_

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "engine/base/status.h"
#include "fovea/v1/datasets.pb.h"
#include "service/access/gate.h"
#include "service/server/services.h"
#include "service/server/step_feed.h"
#include "service/wire/requests.h"

namespace fovea::server {

/// Where the events of a watch go. Called from any thread, never twice at a time for writes.
class EventSink {
 public:
  virtual ~EventSink() = default;
  /// `event` stays as it is until the stream is told of the end of the write.
  virtual void Write(const v1::DatasetEvent& event) = 0;
  /// Once; nothing is called after it.
  virtual void Finish(const Status& status) = 0;
};

/// One WatchDataset: tells its client what has changed since the message before, in one message
/// however much that is; while one is being sent, nothing is kept but how things stand now. Knows
/// no gRPC. A job of it may outlast the call: share it. Thread-safe.
class WatchStream final : public StepListener, public std::enable_shared_from_this<WatchStream> {
 public:
  static constexpr int64_t kMaxStepsPerEvent = 1000;

  /// `sink` must live until its Finish is called. Use std::make_shared.
  WatchStream(Services& services, EventSink& sink) : services_(services), sink_(sink) {}

  /// Starts the stream for `caller`, or ends it with what is wrong with `request`, or why it was
  /// not let in. Call once, and first.
  void Start(StatusOr<wire::WatchRequest> request, std::shared_ptr<access::Caller> caller);
  void OnNews(const DatasetNews& news) override;
  void OnWriteDone(bool ok);
  void OnCancel();

 private:
  /// What to tell, with mutex_ held: nothing, or what takes the client from `told_` to `news_`.
  [[nodiscard]] bool HasNews() const;
  void Advance();
  void Build();
  [[nodiscard]] static Status AddSteps(const DatasetNews& news, int64_t first,
                                       v1::DatasetEvent* event);
  [[nodiscard]] bool IsGone(const DatasetNews& news) const;
  void Forget(const DatasetNews& news);
  void End(Status status);

  Services& services_;
  EventSink& sink_;
  std::shared_ptr<access::Caller> caller_;  // not changed after Start
  wire::WatchRequest request_;              // not changed after Start

  std::mutex mutex_;
  // All below: guarded by mutex_.
  std::optional<DatasetNews> news_;
  std::optional<std::shared_ptr<ServedDataset>> told_;  // what the client knows of; null: absent
  uint64_t next_ = 0;                                   // the step to tell of next
  std::optional<Status> end_;                           // ends when what is under way is done
  bool building_ = false, writing_ = false, finished_ = false;
  v1::DatasetEvent event_;  // the sink's while a write is in flight
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_WATCH_STREAM_H_
