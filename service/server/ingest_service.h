#ifndef SERVICE_SERVER_INGEST_SERVICE_H_
#define SERVICE_SERVER_INGEST_SERVICE_H_

#include "fovea/v1/ingest.grpc.pb.h"
#include "service/server/services.h"

namespace fovea::server {

/// fovea.v1.Ingest. Thread-safe.
class IngestService final : public v1::Ingest::CallbackService {
 public:
  explicit IngestService(Services& services) : services_(services) {}

  grpc::ServerBidiReactor<v1::StreamReadingsRequest, v1::StreamReadingsResponse>* StreamReadings(
      grpc::CallbackServerContext* context) override;
  grpc::ServerReadReactor<v1::UploadStepRequest>* UploadStep(
      grpc::CallbackServerContext* context, v1::UploadStepResponse* response) override;
  grpc::ServerUnaryReactor* IngestFiles(grpc::CallbackServerContext* context,
                                        const v1::IngestFilesRequest* request,
                                        v1::Job* response) override;

 private:
  Services& services_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_INGEST_SERVICE_H_
