#ifndef SERVICE_CLIENT_READING_SENDER_IMPL_H_
#define SERVICE_CLIENT_READING_SENDER_IMPL_H_

#include <deque>
#include <functional>
#include <memory>

#include <grpcpp/client_context.h>

#include "fovea/v1/ingest.grpc.pb.h"
#include "service/client/reading_call.h"
#include "service/client/reading_sender.h"

namespace fovea::client {

/// A ReadingSender over calls of `stub`, which must outlive it.
class GrpcReadingSender final : public ReadingSender {
 public:
  using Prepare = std::function<void(grpc::ClientContext*)>;
  /// How long a server may be away before sending fails.
  static constexpr double kAwaySeconds = 60;
  /// How often it tries again, one after the other, what the server has no room for.
  static constexpr int kMostFruitless = 10;

  /// Opens the first call and waits until the dataset is ready.
  [[nodiscard]] static StatusOr<std::unique_ptr<ReadingSender>> Open(v1::Ingest::Stub& stub,
                                                                     Prepare prepare,
                                                                     const ReadingsSpec& spec,
                                                                     double deadline_seconds,
                                                                     OnHeld on_held);

  [[nodiscard]] Status Send(std::span<const sensors::Reading> readings,
                            std::span<const float> values) override;
  [[nodiscard]] Status Finish() override;
  [[nodiscard]] SendingReport report() const override;

 private:
  GrpcReadingSender(v1::Ingest::Stub& stub, Prepare prepare, const ReadingsSpec& spec,
                    double deadline_seconds, OnHeld on_held);
  [[nodiscard]] Status StartCall();
  [[nodiscard]] Status SendBatch(wire::ReadingBatch batch);
  /// Ends a call that broke and makes another, with all that was not acknowledged. `why` if it
  /// broke for good.
  [[nodiscard]] Status Resume(Status why);
  [[nodiscard]] bool SendWaiting();
  void TakeAnswer();

  v1::Ingest::Stub& stub_;
  const Prepare prepare_;
  const double deadline_seconds_;
  const OnHeld on_held_;
  const int fields_;
  v1::StreamReadingsRequest header_;
  std::unique_ptr<ReadingCall> call_;
  std::deque<v1::StreamReadingsRequest> unacknowledged_;
  size_t written_ = 0;  // of these, in this call
  uint64_t sequence_ = 0;
  int fruitless_ = 0;  // calls for which the server had no room, since a batch was safe
  SendingReport report_;
  sensors::ReadingCounts counts_before_;  // of calls that are over
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_READING_SENDER_IMPL_H_
