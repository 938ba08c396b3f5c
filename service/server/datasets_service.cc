#include "service/server/datasets_service.h"

#include <memory>
#include <string>
#include <utility>

#include <spdlog/spdlog.h>

#include "service/server/admission.h"
#include "service/server/frame_job.h"
#include "service/server/unary_call.h"
#include "service/server/watch_stream.h"
#include "service/wire/convert.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

v1::ListDatasetsResponse List(Catalogue& catalogue, const access::Caller& caller,
                              const wire::ListRequest& request) {
  v1::ListDatasetsResponse response;
  const Catalogue::Page page = catalogue.List(
      request.after, request.page_size, [&](const std::string& name) { return caller.Sees(name); });
  for (const auto& dataset : page.datasets) {
    const auto summary = dataset->Summary(false);
    if (!summary.ok()) {
      spdlog::warn("dataset '{}': {}", dataset->name(), MessageOf(summary.status()));
      continue;
    }
    *response.add_datasets() = wire::ToProto(*summary);
  }
  if (page.more) {
    response.set_next_page_token(wire::PageTokenAfter(page.datasets.back()->name()));
  }
  return response;
}

StatusOr<v1::Dataset> Get(Catalogue& catalogue, const std::string& name) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, catalogue.Find(name));
  FOVEA_ASSIGN_OR_RETURN(const wire::DatasetSummary summary, dataset->Summary(true));
  return wire::ToProto(summary);
}

/// A WatchStream on gRPC. Deletes itself when gRPC is done with it; the stream lives on for as long
/// as jobs of it do.
class WatchReactor final : public grpc::ServerWriteReactor<v1::DatasetEvent>, public EventSink {
 public:
  WatchReactor(Services& services, const grpc::CallbackServerContext& context,
               const v1::WatchDatasetRequest& request)
      : stream_(std::make_shared<WatchStream>(services, *this)) {
    auto admission = Admit(services, context,
                           {.dataset = request.dataset(),
                            .bytes_in = static_cast<int64_t>(request.ByteSizeLong()),
                            .stream = true});
    if (!admission.ok()) {
      stream_->Start(admission.status(), nullptr);
      return;
    }
    admission_ = *std::move(admission);
    stream_->Start(wire::FromProto(request), admission_.caller);
  }

  void Write(const v1::DatasetEvent& event) override { StartWrite(&event); }
  void Finish(const Status& status) override {
    grpc::ServerWriteReactor<v1::DatasetEvent>::Finish(wire::ToGrpc(status));
  }
  void OnWriteDone(bool ok) override { stream_->OnWriteDone(ok); }
  void OnCancel() override { stream_->OnCancel(); }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
  const std::shared_ptr<WatchStream> stream_;
};

StatusOr<v1::Histogram> CountValues(Catalogue& catalogue, const wire::HistogramRequest& request) {
  FOVEA_ASSIGN_OR_RETURN(const auto served, catalogue.Find(request.dataset));
  store::Dataset& dataset = served->dataset();
  FOVEA_ASSIGN_OR_RETURN(const int64_t step,
                         ChooseStep(request.dataset, dataset, request.step, request.time_ns));
  const std::string field = request.field.value_or(dataset.info().default_field);
  FOVEA_ASSIGN_OR_RETURN(const FieldStats stats, dataset.Stats(step, field));
  v1::Histogram histogram;
  histogram.set_dataset(request.dataset);
  histogram.set_field(field);
  histogram.set_step(static_cast<uint64_t>(step));
  histogram.set_minimum(stats.minimum);
  histogram.set_maximum(stats.maximum);
  histogram.mutable_counts()->Add(stats.histogram.begin(), stats.histogram.end());
  return histogram;
}

}  // namespace

grpc::ServerUnaryReactor* DatasetsService::ListDatasets(grpc::CallbackServerContext* context,
                                                        const v1::ListDatasetsRequest* request,
                                                        v1::ListDatasetsResponse* response) {
  const auto call = UnaryCall<v1::ListDatasetsResponse>::Start(
      services_, *context, {.bytes_in = static_cast<int64_t>(request->ByteSizeLong())}, response);
  auto parsed = wire::FromProto(*request);
  if (!parsed.ok()) {
    call->Complete(parsed.status());
    return call.get();
  }
  call->Enqueue(services_.lookups, 0,
                [call, &services = services_, request = *std::move(parsed)](int) {
                  call->Complete(List(*services.catalogue, call->caller(), request));
                });
  return call.get();
}

grpc::ServerUnaryReactor* DatasetsService::GetDataset(grpc::CallbackServerContext* context,
                                                      const v1::GetDatasetRequest* request,
                                                      v1::Dataset* response) {
  const auto call = UnaryCall<v1::Dataset>::Start(
      services_, *context,
      {.dataset = request->dataset(), .bytes_in = static_cast<int64_t>(request->ByteSizeLong())},
      response);
  if (const Status named = wire::CheckDatasetName(request->dataset()); !named.ok()) {
    call->Complete(named);
    return call.get();
  }
  call->Enqueue(services_.lookups, 0,
                [call, &services = services_, name = request->dataset()](int) {
                  call->Complete(Get(*services.catalogue, name));
                });
  return call.get();
}

grpc::ServerWriteReactor<v1::DatasetEvent>* DatasetsService::WatchDataset(
    grpc::CallbackServerContext* context, const v1::WatchDatasetRequest* request) {
  return new WatchReactor(services_, *context, *request);  // deletes itself
}

grpc::ServerUnaryReactor* DatasetsService::GetHistogram(grpc::CallbackServerContext* context,
                                                        const v1::GetHistogramRequest* request,
                                                        v1::Histogram* response) {
  const auto call = UnaryCall<v1::Histogram>::Start(
      services_, *context,
      {.dataset = request->dataset(), .bytes_in = static_cast<int64_t>(request->ByteSizeLong())},
      response);
  auto parsed = wire::FromProto(*request);
  if (!parsed.ok()) {
    call->Complete(parsed.status());
    return call.get();
  }
  call->Enqueue(services_.lookups, 0,
                [call, &services = services_, request = *std::move(parsed)](int) {
                  call->Complete(CountValues(*services.catalogue, request));
                });
  return call.get();
}

}  // namespace fovea::server
