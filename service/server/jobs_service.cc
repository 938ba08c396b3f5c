#include "service/server/jobs_service.h"

#include <charconv>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "service/jobs/job_message.h"
#include "service/server/admission.h"
#include "service/server/job_watch.h"
#include "service/server/new_job.h"
#include "service/server/unary_call.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// Lets the call in, and does `work` where it may wait for the disk.
template <typename Request, typename Response, typename Work>
grpc::ServerUnaryReactor* Answer(Services& services, const grpc::CallbackServerContext& context,
                                 Ask ask, const Request& request, Response* response, Work work) {
  ask.request = &request;
  const auto call = UnaryCall<Response>::Start(services, context, std::move(ask), response);
  call->Enqueue(services.lookups, 0, [call, &services, request, work = std::move(work)](int) {
    call->Complete(work(services, call->caller(), request));
  });
  return call.get();
}

Status CheckId(const std::string& id) {
  return id.empty() ? wire::BadField("id", "is empty; ListJobs says which there are")
                    : absl::OkStatus();
}

/// Of one job, by `ask`, which is a method of the runner.
template <typename Method>
StatusOr<v1::Job> OneJob(Services& services, const access::Caller& caller, const std::string& id,
                         Method ask) {
  FOVEA_ASSIGN_OR_RETURN(jobs::JobRunner * runner, JobsOf(services));
  FOVEA_RETURN_IF_ERROR(CheckId(id));
  const auto job = (runner->*ask)(caller.name(), id);
  if (absl::IsNotFound(job.status())) {
    return NoJob(id);
  }
  FOVEA_RETURN_IF_ERROR(job.status());
  return jobs::ToProto(*job);
}

/// The job that the page before ended with: its number.
StatusOr<int64_t> NumberOf(const std::string& text) {
  int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || number < 0) {
    return wire::BadField("page_token", "is no next_page_token of this server");
  }
  return number;
}

StatusOr<v1::ListJobsResponse> List(Services& services, const access::Caller& caller,
                                    const v1::ListJobsRequest& request) {
  FOVEA_ASSIGN_OR_RETURN(jobs::JobRunner * runner, JobsOf(services));
  v1::ListDatasetsRequest page;  // has the same rules
  page.set_page_size(request.page_size());
  page.set_page_token(request.page_token());
  FOVEA_ASSIGN_OR_RETURN(const wire::ListRequest asked, wire::FromProto(page));
  int64_t before = std::numeric_limits<int64_t>::max();
  if (!request.page_token().empty()) {
    FOVEA_ASSIGN_OR_RETURN(before, NumberOf(asked.after));
  }
  const int64_t limit = asked.page_size;
  FOVEA_ASSIGN_OR_RETURN(std::vector<jobs::Job> jobs,
                         runner->List(caller.name(), before, limit + 1));
  v1::ListJobsResponse response;
  if (std::ssize(jobs) > limit) {
    jobs.pop_back();
    response.set_next_page_token(wire::PageTokenAfter(std::to_string(jobs.back().number)));
  }
  for (const jobs::Job& job : jobs) {
    v1::Job* listed = response.add_jobs();
    *listed = jobs::ToProto(job);
    listed->clear_failures();
    listed->clear_warnings();
  }
  return response;
}

}  // namespace

grpc::ServerUnaryReactor* JobsService::CreateExport(grpc::CallbackServerContext* context,
                                                    const v1::CreateExportRequest* request,
                                                    v1::Job* response) {
  return Answer(services_, *context,
                {.right = access::Right::kWrite, .dataset = request->dataset()}, *request, response,
                NewExport);
}

grpc::ServerUnaryReactor* JobsService::GetJob(grpc::CallbackServerContext* context,
                                              const v1::GetJobRequest* request, v1::Job* response) {
  return Answer(services_, *context, {}, *request, response,
                [](Services& services, const access::Caller& caller, const auto& asked) {
                  return OneJob(services, caller, asked.id(), &jobs::JobRunner::Get);
                });
}

grpc::ServerUnaryReactor* JobsService::ListJobs(grpc::CallbackServerContext* context,
                                                const v1::ListJobsRequest* request,
                                                v1::ListJobsResponse* response) {
  return Answer(services_, *context, {}, *request, response, List);
}

grpc::ServerWriteReactor<v1::Job>* JobsService::WatchJob(grpc::CallbackServerContext* context,
                                                         const v1::WatchJobRequest* request) {
  return JobWatch::Start(services_, *context, *request);
}

grpc::ServerUnaryReactor* JobsService::CancelJob(grpc::CallbackServerContext* context,
                                                 const v1::CancelJobRequest* request,
                                                 v1::Job* response) {
  return Answer(services_, *context, {.right = access::Right::kWrite}, *request, response,
                [](Services& services, const access::Caller& caller, const auto& asked) {
                  return OneJob(services, caller, asked.id(), &jobs::JobRunner::Cancel);
                });
}

}  // namespace fovea::server
