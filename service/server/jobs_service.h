#ifndef SERVICE_SERVER_JOBS_SERVICE_H_
#define SERVICE_SERVER_JOBS_SERVICE_H_

#include "fovea/v1/jobs.grpc.pb.h"
#include "service/server/services.h"

namespace fovea::server {

/// fovea.v1.Jobs. Thread-safe.
class JobsService final : public v1::Jobs::CallbackService {
 public:
  explicit JobsService(Services& services) : services_(services) {}

  grpc::ServerUnaryReactor* CreateExport(grpc::CallbackServerContext* context,
                                         const v1::CreateExportRequest* request,
                                         v1::Job* response) override;
  grpc::ServerUnaryReactor* GetJob(grpc::CallbackServerContext* context,
                                   const v1::GetJobRequest* request, v1::Job* response) override;
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* context,
                                     const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override;
  grpc::ServerWriteReactor<v1::Job>* WatchJob(grpc::CallbackServerContext* context,
                                              const v1::WatchJobRequest* request) override;
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* context,
                                      const v1::CancelJobRequest* request,
                                      v1::Job* response) override;

 private:
  Services& services_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_JOBS_SERVICE_H_
