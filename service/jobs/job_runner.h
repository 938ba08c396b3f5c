#ifndef SERVICE_JOBS_JOB_RUNNER_H_
#define SERVICE_JOBS_JOB_RUNNER_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "engine/base/status.h"
#include "service/jobs/job.h"
#include "service/jobs/job_process.h"
#include "service/jobs/job_request.h"
#include "service/jobs/job_table.h"

namespace fovea::jobs {

struct RunnerOptions {
  std::string state;      // folder of the table; made if it is not there
  Folders folders;        // as they were given: they are made canonical
  int at_once = 1;        // jobs that run at a time
  int threads = 0;        // of each; 0: all processors
  std::string program{};  // of JobProcess
  /// Called when an ingest to this dataset has ended, before anybody is told. From the runner's
  /// threads; may be empty.
  std::function<void(const std::string& dataset)> on_made{};
  /// How long the state folder may be another's: that of a server that was killed is free when the
  /// processes of its jobs have died.
  std::chrono::milliseconds lock_limit{10'000};
};

/// One who wants to know how a job stands.
class JobListener {
 public:
  virtual ~JobListener() = default;
  /// First soon after Watch, then after changes, at most every JobRunner::kTellInterval; lastly at
  /// its end. From the runner's threads: must not wait.
  virtual void OnJob(const Job& job) = 0;
  /// Nothing more will come: the server shuts down.
  virtual void OnClosing() = 0;
};

/// Keeps the jobs of a server and runs them, each in a process of its own, in the order of their
/// making. What ran or waited when the server went is queued again at the next Open. Jobs are known
/// to their owner only. Calls other than Watch wait for the disk. Thread-safe.
class JobRunner {
 public:
  static constexpr std::chrono::milliseconds kTellInterval{200};
  static constexpr int64_t kMaxUnended = 1000;  // jobs
  static constexpr int64_t kMaxEnded = 10'000;  // jobs that are kept after their end

  /// FAILED_PRECONDITION if another server uses the state folder, or it holds no table of ours;
  /// for folders as MakeCanonical.
  [[nodiscard]] static StatusOr<std::unique_ptr<JobRunner>> Open(const RunnerOptions& options);
  /// As Stop.
  ~JobRunner();
  JobRunner(const JobRunner&) = delete;
  JobRunner& operator=(const JobRunner&) = delete;

  [[nodiscard]] const Folders& folders() const { return options_.folders; }

  /// Queues a job of this kind, owner, dataset, target and request. RESOURCE_EXHAUSTED for too many
  /// that have not ended, or a full disk.
  [[nodiscard]] StatusOr<Job> Create(Job job);
  /// NOT_FOUND for one that is not there, or another's: so in what follows.
  [[nodiscard]] StatusOr<Job> Get(const std::string& owner, const std::string& id);
  /// As JobTable::List.
  [[nodiscard]] StatusOr<std::vector<Job>> List(const std::string& owner, int64_t before,
                                                int64_t limit);
  /// A job of anybody, that has not ended, about this dataset.
  [[nodiscard]] std::optional<Job> UnendedOn(const std::string& dataset);
  /// How it stands after that; one that runs ends within a second.
  [[nodiscard]] StatusOr<Job> Cancel(const std::string& owner, const std::string& id);
  /// Of all owners: those that wait and run now, and those that ended since Open. Waits for no
  /// disk.
  struct Counts {
    int64_t queued = 0, running = 0;
    int64_t done = 0, failed = 0, cancelled = 0;
  };
  [[nodiscard]] Counts counts();
  /// Until the listener is gone, or the job has ended.
  [[nodiscard]] Status Watch(const std::string& owner, const std::string& id,
                             std::weak_ptr<JobListener> listener);
  /// Tells every listener that nothing more comes, ends what runs, cleanly where that is quick, and
  /// leaves it to the next start. May be called twice.
  void Stop();

 private:
  using Clock = std::chrono::steady_clock;
  /// A job that has not ended.
  struct Live {
    Job job;
    bool cancelled = false;
    std::vector<std::weak_ptr<JobListener>> listeners;
  };
  /// What the thread that runs a job knows of it beside Live.
  struct Attempt {
    Clock::time_point first_progress, told, saved, asked_to_stop;
    int64_t done_before = -1;  // at the first progress
    size_t saved_failures = 0;
    bool is_told = true, is_saved = true;  // how it stands now
    bool was_asked = false, was_killed = false;
  };
  enum class Wish { kGoOn, kCancel, kStop };

  JobRunner(RunnerOptions options, int lock, std::unique_ptr<JobTable> table)
      : options_(std::move(options)), lock_(lock), table_(std::move(table)) {}

  Status TakeUp();
  void Work();
  void RunOne(Live* live);
  [[nodiscard]] Status Attend(Live* live, JobProcess* process, Attempt* attempt);
  void TakeReports(Live* live, const std::vector<Report>& reports, Attempt* attempt);
  void Finish(Live* live, const Status& status, Attempt* attempt);
  void Tidy(const Job& job) const;
  [[nodiscard]] Wish WishFor(const Live& live);
  void Save(const Live& live, Attempt* attempt);
  void Tell(Live* live);
  [[nodiscard]] StatusOr<Job> Find(const std::string& owner, const std::string& id);

  const RunnerOptions options_;
  const int lock_;  // descriptor; held by the processes of jobs, too
  const std::unique_ptr<JobTable> table_;

  std::mutex mutex_;
  std::condition_variable changed_;
  // All below: guarded by mutex_. The job of a Live that runs is changed by its thread alone, under
  // the mutex.
  std::map<std::string, std::unique_ptr<Live>> live_;  // by id
  std::deque<Live*> queue_;
  Counts ended_;  // without those that have not
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_RUNNER_H_
