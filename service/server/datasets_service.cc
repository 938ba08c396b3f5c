#include "service/server/datasets_service.h"

#include <string>
#include <utility>

#include <spdlog/spdlog.h>

#include "service/server/unary_call.h"
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

}  // namespace

grpc::ServerUnaryReactor* DatasetsService::ListDatasets(grpc::CallbackServerContext* context,
                                                        const v1::ListDatasetsRequest* request,
                                                        v1::ListDatasetsResponse* response) {
  const auto call = UnaryCall<v1::ListDatasetsResponse>::Start(
      services_, *context, "ListDatasets",
      {.bytes_in = static_cast<int64_t>(request->ByteSizeLong())}, response);
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
      services_, *context, "GetDataset",
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

}  // namespace fovea::server
