#ifndef SERVICE_CLIENT_EVENT_READER_H_
#define SERVICE_CLIENT_EVENT_READER_H_

#include <memory>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/async_stream.h>

#include "engine/base/status.h"
#include "fovea/v1/datasets.grpc.pb.h"
#include "service/client/call_options.h"
#include "service/client/dataset_watch.h"

namespace fovea::client {

/// Reads one WatchDataset in the caller's thread. Cancels what is left of the call when it goes.
/// Not thread-safe.
class EventReader {
 public:
  EventReader(v1::Datasets::Stub& stub, const v1::WatchDatasetRequest& request,
              const CallMetadata& metadata);
  ~EventReader();
  EventReader(const EventReader&) = delete;
  EventReader& operator=(const EventReader&) = delete;

  /// Calls `on_event` for each event until that, or `go_on`, returns false: then OK, and `stopped`
  /// is true. Otherwise how the call ended. INTERNAL for what the proto does not promise.
  [[nodiscard]] Status Run(const OnEvent& on_event, const GoOn& go_on);
  [[nodiscard]] bool stopped() const { return stopped_; }

 private:
  /// Waits for the operation under way; false if it failed, or `go_on` does.
  [[nodiscard]] bool Wait(const GoOn& go_on);

  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::ClientAsyncReader<v1::DatasetEvent>> reader_;
  bool stopped_ = false;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_EVENT_READER_H_
