#ifndef SERVICE_JOBS_INGEST_ERRORS_H_
#define SERVICE_JOBS_INGEST_ERRORS_H_

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "service/jobs/job.h"

/// What an ingest says, for whoever asked for the job. Thread-safe.
namespace fovea::jobs {

/// The file that an error is about, and why: errors about a file begin with its name. Nothing for
/// all others: no file is to blame. `files` are named as in `message`.
[[nodiscard]] std::optional<Failure> FailureOf(std::string_view message,
                                               const std::vector<std::string>& files);

/// `text`, which is written for `fovea ingest`; if it advises flags that jobs do not have, it says
/// so.
[[nodiscard]] std::string ForJobs(std::string text);

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_INGEST_ERRORS_H_
