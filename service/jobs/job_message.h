#ifndef SERVICE_JOBS_JOB_MESSAGE_H_
#define SERVICE_JOBS_JOB_MESSAGE_H_

#include "fovea/v1/jobs.pb.h"
#include "service/jobs/job.h"

namespace fovea::jobs {

/// What clients see of a job.
[[nodiscard]] v1::Job ToProto(const Job& job);

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_MESSAGE_H_
