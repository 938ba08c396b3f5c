#include "service/server/new_job.h"

#include <string>
#include <utility>

#include "service/frames/frames.h"
#include "service/jobs/job_message.h"
#include "service/jobs/job_request.h"
#include "service/jobs/safe_path.h"
#include "service/wire/convert.h"
#include "service/wire/printable.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// What a caller may not see is not there.
Status CheckSees(const access::Caller& caller, const std::string& name) {
  return caller.Sees(name) ? absl::OkStatus()
                           : NotFound("'{}' is not there: name files below the folder '{}'",
                                      wire::Printable(name), caller.token().prefix);
}

/// At once for a name that is not there, or in no folder that is; whether a pattern has files the
/// job finds out. `name` is below the root.
Status CheckThere(const std::string& name, const std::string& root) {
  const size_t slash = name.rfind('/');
  const bool is_pattern =
      name.find_first_of("*?[#%", slash == std::string::npos ? 0 : slash) != std::string::npos;
  if (is_pattern && slash == std::string::npos) {
    return absl::OkStatus();
  }
  return jobs::CheckBelow(root, {root + "/" + (is_pattern ? name.substr(0, slash) : name)});
}

StatusOr<v1::Job> Queue(jobs::JobRunner* runner, const access::Caller& caller, jobs::Job job) {
  job.owner = caller.name();
  FOVEA_ASSIGN_OR_RETURN(const jobs::Job queued, runner->Create(std::move(job)));
  return jobs::ToProto(queued);
}

/// What is left to default is as it is now, whenever the job runs.
Status PinSteps(int64_t committed, v1::CreateExportRequest* request) {
  const uint64_t last =
      request->steps().has_last() ? request->steps().last() : static_cast<uint64_t>(committed) - 1;
  FOVEA_RETURN_IF_ERROR(Annotate(
      wire::CheckStep(request->dataset(), request->steps().first(), committed), "steps.first"));
  FOVEA_RETURN_IF_ERROR(
      Annotate(wire::CheckStep(request->dataset(), last, committed), "steps.last"));
  request->mutable_steps()->set_last(last);
  return absl::OkStatus();
}

}  // namespace

StatusOr<jobs::JobRunner*> JobsOf(Services& services) {
  if (services.jobs == nullptr) {
    return FailedPrecondition("this server keeps no jobs; it must be started with --state DIR");
  }
  return services.jobs.get();
}

Status NoJob(std::string_view id) {
  return wire::WithResource(
      NotFound("there is no job '{}'; ListJobs says which there are", wire::Printable(id)),
      "fovea.v1.Job", wire::Printable(id));
}

StatusOr<v1::Job> NewIngest(Services& services, const access::Caller& caller,
                            const v1::IngestFilesRequest& request) {
  FOVEA_ASSIGN_OR_RETURN(jobs::JobRunner * runner, JobsOf(services));
  if (runner->folders().ingest_root.empty()) {
    return FailedPrecondition(
        "this server ingests no files; it must be started with --ingest-root DIR");
  }
  for (const std::string& file : request.files()) {
    FOVEA_RETURN_IF_ERROR(CheckSees(caller, file));
  }
  FOVEA_RETURN_IF_ERROR(jobs::IngestOptionsOf(request, runner->folders()).status());
  for (const std::string& file : request.files()) {
    FOVEA_RETURN_IF_ERROR(CheckThere(file, runner->folders().ingest_root));
  }
  FOVEA_RETURN_IF_ERROR(services.catalogue->PathOfNew(request.dataset()).status());
  jobs::Job job;
  job.kind = jobs::Kind::kIngestFiles;
  job.dataset = request.dataset();
  job.request = request.SerializeAsString();
  return Queue(runner, caller, std::move(job));
}

StatusOr<v1::Job> NewExport(Services& services, const access::Caller& caller,
                            v1::CreateExportRequest request) {
  FOVEA_ASSIGN_OR_RETURN(jobs::JobRunner * runner, JobsOf(services));
  if (runner->folders().export_root.empty()) {
    return FailedPrecondition(
        "this server exports no frames; it must be started with --export-root DIR");
  }
  if (!caller.Sees(request.output())) {
    return wire::BadField(
        "output", fmt::format("'{}' is not below the folder '{}', where this token may write",
                              wire::Printable(request.output()), caller.token().prefix));
  }
  FOVEA_ASSIGN_OR_RETURN(const exports::ExportOptions options,
                         jobs::ExportOptionsOf(request, runner->folders()));
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, services.catalogue->FindNow(request.dataset()));
  FOVEA_RETURN_IF_ERROR(PinSteps(dataset->dataset().info().committed_steps, &request));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, dataset->DefaultSpec());
  const auto spec = frames::ResolveSpec(dataset->dataset(), options.spec, defaults);
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(spec.status(), "spec"));
  *request.mutable_spec() = wire::ToProto(*spec);
  jobs::Job job;
  job.kind = jobs::Kind::kExport;
  job.dataset = request.dataset();
  job.target = request.output();
  job.request = request.SerializeAsString();
  return Queue(runner, caller, std::move(job));
}

}  // namespace fovea::server
