#include "service/server/datasets_service.h"

#include <optional>
#include <string>
#include <utility>

#include <spdlog/spdlog.h>

#include "service/server/frame_job.h"
#include "service/server/stream_reactor.h"
#include "service/server/unary_call.h"
#include "service/server/watch_stream.h"
#include "service/wire/convert.h"
#include "service/wire/requests.h"

namespace fovea::server {
namespace {

v1::ListDatasetsResponse List(Catalogue& catalogue, const access::Caller& caller,
                              const wire::ListRequest& request) {
  v1::ListDatasetsResponse response;
  const Catalogue::Page page = catalogue.List(
      request.after, request.page_size, [&](const std::string& name) { return caller.Sees(name); });
  for (const auto& dataset : page.datasets) {
    const auto summary = dataset->Summary(/*whole=*/false);
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
  FOVEA_ASSIGN_OR_RETURN(const wire::DatasetSummary summary, dataset->Summary(/*whole=*/true));
  return wire::ToProto(summary);
}

StatusOr<v1::Histogram> CountValues(Catalogue& catalogue, const wire::HistogramRequest& request) {
  FOVEA_ASSIGN_OR_RETURN(const auto served, catalogue.Find(request.dataset));
  store::Dataset& dataset = served->dataset();
  FOVEA_ASSIGN_OR_RETURN(const int64_t step,
                         ChooseStep(request.dataset, dataset, request.step, request.time_ns));
  const std::string field = request.field.value_or(dataset.info().default_field);
  auto counted = dataset.Stats(step, field);
  FOVEA_RETURN_IF_ERROR(served->CheckPresent());
  FOVEA_ASSIGN_OR_RETURN(const FieldStats stats, std::move(counted));
  v1::Histogram histogram;
  histogram.set_dataset(request.dataset);
  histogram.set_field(field);
  histogram.set_step(static_cast<uint64_t>(step));
  histogram.set_minimum(stats.minimum);
  histogram.set_maximum(stats.maximum);
  histogram.mutable_counts()->Add(stats.histogram.begin(), stats.histogram.end());
  return histogram;
}

StatusOr<v1::DeleteDatasetResponse> Delete(Services& services, const access::Caller& caller,
                                           const std::string& name) {
  const auto job = services.jobs == nullptr ? std::nullopt : services.jobs->UnendedOn(name);
  if (job) {
    const bool own = job->owner == caller.name();
    return FailedPrecondition("dataset '{}' is not removed: {} has not ended that {} it; {}", name,
                              own ? job->id : "a job of another token",
                              job->kind == jobs::Kind::kExport ? "shows" : "writes",
                              own ? "wait, or cancel the job" : "try again when it has");
  }
  const Status removed = services.catalogue->Remove(name);
  services.steps.Poke(name);
  FOVEA_RETURN_IF_ERROR(removed);
  spdlog::info("dataset '{}' was removed", name);
  return v1::DeleteDatasetResponse();
}

}  // namespace

grpc::ServerUnaryReactor* DatasetsService::ListDatasets(grpc::CallbackServerContext* context,
                                                        const v1::ListDatasetsRequest* request,
                                                        v1::ListDatasetsResponse* response) {
  const auto call = UnaryCall<v1::ListDatasetsResponse>::Start(services_, *context,
                                                               {.request = request}, response);
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
      services_, *context, {.dataset = request->dataset(), .request = request}, response);
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

grpc::ServerUnaryReactor* DatasetsService::DeleteDataset(grpc::CallbackServerContext* context,
                                                         const v1::DeleteDatasetRequest* request,
                                                         v1::DeleteDatasetResponse* response) {
  const auto call = UnaryCall<v1::DeleteDatasetResponse>::Start(
      services_, *context,
      {.right = access::Right::kWrite, .dataset = request->dataset(), .request = request},
      response);
  if (const Status named = wire::CheckDatasetName(request->dataset()); !named.ok()) {
    call->Complete(named);
    return call.get();
  }
  // Many files take long to remove: not beside what must be quick.
  call->Enqueue(services_.ingests, 0,
                [call, &services = services_, name = request->dataset()](int) {
                  call->Complete(Delete(services, call->caller(), name));
                });
  return call.get();
}

grpc::ServerWriteReactor<v1::DatasetEvent>* DatasetsService::WatchDataset(
    grpc::CallbackServerContext* context, const v1::WatchDatasetRequest* request) {
  using Reactor = StreamReactor<v1::DatasetEvent, EventSink, WatchStream>;
  return new Reactor(services_, *context, *request);  // deletes itself
}

grpc::ServerUnaryReactor* DatasetsService::GetHistogram(grpc::CallbackServerContext* context,
                                                        const v1::GetHistogramRequest* request,
                                                        v1::Histogram* response) {
  return LookUp(services_, *context, *request, response,
                [&services = services_](const wire::HistogramRequest& asked) {
                  return CountValues(*services.catalogue, asked);
                });
}

}  // namespace fovea::server
