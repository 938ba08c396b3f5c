#ifndef SERVICE_SERVER_NEW_JOB_H_
#define SERVICE_SERVER_NEW_JOB_H_

#include <string_view>

#include "engine/base/status.h"
#include "fovea/v1/ingest.pb.h"
#include "fovea/v1/jobs.pb.h"
#include "service/access/gate.h"
#include "service/jobs/job_runner.h"
#include "service/server/services.h"

namespace fovea::server {

/// FAILED_PRECONDITION, naming the flag, where no jobs are kept.
[[nodiscard]] StatusOr<jobs::JobRunner*> JobsOf(Services& services);

/// The error for a job that is not there, or another's.
[[nodiscard]] Status NoJob(std::string_view id);

/// Both: the request checked as far as it can be now, and its job queued for `caller`. They wait
/// for the disk. NOT_FOUND for files that are not there or outside of the caller's prefix, and for
/// the folders of patterns; outputs outside of it are INVALID_ARGUMENT.
[[nodiscard]] StatusOr<v1::Job> NewIngest(Services& services, const access::Caller& caller,
                                          const v1::IngestFilesRequest& request);
[[nodiscard]] StatusOr<v1::Job> NewExport(Services& services, const access::Caller& caller,
                                          v1::CreateExportRequest request);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_NEW_JOB_H_
