#ifndef SERVICE_SERVER_DATASETS_SERVICE_H_
#define SERVICE_SERVER_DATASETS_SERVICE_H_

#include "fovea/v1/datasets.grpc.pb.h"
#include "service/server/services.h"

namespace fovea::server {

/// fovea.v1.Datasets. Thread-safe.
class DatasetsService final : public v1::Datasets::CallbackService {
 public:
  explicit DatasetsService(Services& services) : services_(services) {}

  grpc::ServerUnaryReactor* ListDatasets(grpc::CallbackServerContext* context,
                                         const v1::ListDatasetsRequest* request,
                                         v1::ListDatasetsResponse* response) override;
  grpc::ServerUnaryReactor* GetHistogram(grpc::CallbackServerContext* context,
                                         const v1::GetHistogramRequest* request,
                                         v1::Histogram* response) override;
  grpc::ServerUnaryReactor* GetDataset(grpc::CallbackServerContext* context,
                                       const v1::GetDatasetRequest* request,
                                       v1::Dataset* response) override;
  grpc::ServerUnaryReactor* DeleteDataset(grpc::CallbackServerContext* context,
                                          const v1::DeleteDatasetRequest* request,
                                          v1::DeleteDatasetResponse* response) override;
  grpc::ServerWriteReactor<v1::DatasetEvent>* WatchDataset(
      grpc::CallbackServerContext* context, const v1::WatchDatasetRequest* request) override;

 private:
  Services& services_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_DATASETS_SERVICE_H_
