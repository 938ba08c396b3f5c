#ifndef SERVICE_JOBS_JOB_TABLE_H_
#define SERVICE_JOBS_JOB_TABLE_H_

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/jobs/job.h"

struct sqlite3;

namespace fovea::jobs {

/// The jobs of a server, in one SQLite file. What a call has written when it returns no crash loses
/// (write-ahead log, synchronous FULL); a call that fails has changed nothing. Errors:
/// RESOURCE_EXHAUSTED for a full disk, UNAVAILABLE for one that cannot be written or read, both
/// with the file's name. Every call waits for the disk. Thread-safe.
class JobTable {
 public:
  /// Makes the file if it is not there. FAILED_PRECONDITION for one that is no table of jobs, is
  /// damaged, or was made by a later version.
  [[nodiscard]] static StatusOr<std::unique_ptr<JobTable>> Open(const std::string& path);
  ~JobTable();
  JobTable(const JobTable&) = delete;
  JobTable& operator=(const JobTable&) = delete;

  /// Gives it its number.
  [[nodiscard]] Status Insert(Job* job);
  /// With its failures. NOT_FOUND.
  [[nodiscard]] StatusOr<Job> Get(const std::string& id);
  /// Those of `owner` with numbers below `before`, newest first, at most `limit`, without requests
  /// and failures.
  [[nodiscard]] StatusOr<std::vector<Job>> List(const std::string& owner, int64_t before,
                                                int64_t limit);
  /// Those that are queued or run, oldest first, without failures.
  [[nodiscard]] StatusOr<std::vector<Job>> Unended();
  /// State, progress, message, warnings and times, and the failures from number `first_failure` on,
  /// in whose place none were yet; with 0 those that were are dropped.
  [[nodiscard]] Status Update(const Job& job, size_t first_failure);
  /// Drops the oldest jobs that have ended, beyond `keep` of them.
  [[nodiscard]] Status Prune(int64_t keep);

 private:
  class Statement;
  JobTable(std::string path, sqlite3* database) : path_(std::move(path)), database_(database) {}

  [[nodiscard]] Status Prepare();
  [[nodiscard]] Status Execute(const char* sql);
  [[nodiscard]] Status Write(const Job& job, size_t first_failure);  // in a transaction
  [[nodiscard]] StatusOr<std::vector<Job>> ReadJobs(Statement* statement);
  /// The error of the last call.
  [[nodiscard]] Status Error(int code) const;

  const std::string path_;
  std::mutex mutex_;
  sqlite3* const database_;  // guarded by mutex_
};

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_TABLE_H_
