#ifndef SERVICE_JOBS_JOB_PROCESS_H_
#define SERVICE_JOBS_JOB_PROCESS_H_

#include <sys/types.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/jobs/job.h"
#include "service/jobs/job_report.h"
#include "service/jobs/job_request.h"

namespace fovea::jobs {

struct ProcessOptions {
  Folders folders;
  int threads = 0;        // of its work; 0: all processors
  int lock_fd = -1;       // stays open in the process: whoever waits for it waits for its end
  std::string program{};  // empty: fovea-job, where FindProgram finds it
};

/// A process of its own that does a job (RunJob), at a lower priority than the server; it goes with
/// the thread that started it. One thread at a time.
class JobProcess {
 public:
  [[nodiscard]] static StatusOr<std::unique_ptr<JobProcess>> Start(const Job& job,
                                                                   const ProcessOptions& options);
  /// Kills it, and all that it started.
  ~JobProcess();
  JobProcess(const JobProcess&) = delete;
  JobProcess& operator=(const JobProcess&) = delete;

  /// What it has told since the last call; waits for at most `limit` if that is nothing. The last
  /// report of all is an EndReport: how the job ended, or how the process did if it did not say.
  [[nodiscard]] std::vector<Report> Wait(std::chrono::milliseconds limit);

  /// It ends after the step or frame in hand.
  void AskToStop();
  /// It ends at once. Wait tells of its end.
  void Kill();

 private:
  JobProcess(pid_t pid, int output) : pid_(pid), output_(output) {}
  /// False at the end of what it tells.
  [[nodiscard]] bool ReadSome();
  [[nodiscard]] Status Reap();

  pid_t pid_;  // 0: it was waited for
  int output_;
  std::string unread_;  // of the line that has no end yet
};

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_PROCESS_H_
