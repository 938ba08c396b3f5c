#ifndef SERVICE_JOBS_RUN_JOB_H_
#define SERVICE_JOBS_RUN_JOB_H_

#include <functional>
#include <string>

#include "engine/base/status.h"
#include "service/jobs/job.h"
#include "service/jobs/job_report.h"
#include "service/jobs/job_request.h"

namespace fovea::jobs {

struct RunHooks {
  std::function<void(const Report&)> tell;  // progress, failures and warnings, not the end
  std::function<bool()> stopped;            // asked between steps and frames
};

/// Does the work of a job, in this process: what is done already is not done again, so that a job
/// that was cut off at any moment is run again to its end. `request` is Job::request. CANCELLED if
/// stopped. Messages name files below their roots.
[[nodiscard]] Status RunJob(Kind kind, const std::string& request, const Folders& folders,
                            int threads, const RunHooks& hooks);

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_RUN_JOB_H_
