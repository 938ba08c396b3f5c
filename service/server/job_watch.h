#ifndef SERVICE_SERVER_JOB_WATCH_H_
#define SERVICE_SERVER_JOB_WATCH_H_

#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include <grpcpp/support/server_callback.h>

#include "engine/base/status.h"
#include "fovea/v1/jobs.pb.h"
#include "service/jobs/job_runner.h"
#include "service/server/admission.h"
#include "service/server/services.h"

namespace fovea::server {

/// One WatchJob: tells its client how a job stands; while a message is being sent, nothing is kept
/// but how it stands now. Lives until gRPC and the runner have let go of it. Thread-safe.
class JobWatch final : public grpc::ServerWriteReactor<v1::Job>,
                       public jobs::JobListener,
                       public std::enable_shared_from_this<JobWatch> {
 public:
  /// For gRPC. The call is over at once if it is not let in.
  [[nodiscard]] static JobWatch* Start(Services& services,
                                       const grpc::CallbackServerContext& context,
                                       const v1::WatchJobRequest& request);
  JobWatch(Services& services, std::string id) : services_(services), id_(std::move(id)) {}

  void OnJob(const jobs::Job& job) override;
  void OnClosing() override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  void Subscribe();
  void Advance();
  void End(const Status& status);

  Services& services_;
  const std::string id_;
  std::shared_ptr<JobWatch> self_;  // set before gRPC knows of it, reset when gRPC is done
  Admission admission_;             // likewise

  std::mutex mutex_;
  // All below: guarded by mutex_.
  std::optional<v1::Job> news_;  // not sent yet
  bool is_last_ = false;         // of the job: nothing comes after it
  std::optional<Status> end_;    // ends when what is under way is done
  bool writing_ = false, finished_ = false;
  v1::Job message_;  // gRPC's while a write is in flight
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_JOB_WATCH_H_
