#include "service/jobs/job_runner.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <random>
#include <system_error>
#include <utility>

#include <spdlog/spdlog.h>

#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/metadata.h"
#include "engine/store/removal.h"
#include "service/wire/printable.h"

namespace fovea::jobs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kPollInterval = 100ms;   // between looks at what is wished of a job
constexpr auto kSaveInterval = 1000ms;  // between writes of progress
constexpr auto kCancelGrace = 400ms;    // from being asked to being killed
constexpr auto kStopGrace = 5000ms;

int64_t NowMs() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::string NewId() {
  std::random_device random;
  return fmt::format("job-{:08x}{:08x}{:08x}{:08x}", random(), random(), random(), random());
}

/// The lock on the state folder; waits for the processes of a server that was killed.
StatusOr<int> LockFolder(const std::string& folder, std::chrono::milliseconds limit) {
  const std::string path = folder + "/lock";
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock < 0) {
    return FailedPrecondition("--state: '{}' cannot be written: {}", path, std::strerror(errno));
  }
  const auto end = std::chrono::steady_clock::now() + limit;
  while (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
    if (std::chrono::steady_clock::now() > end) {
      ::close(lock);
      return FailedPrecondition("--state: another server uses '{}'; give each a folder of its own",
                                folder);
    }
    std::this_thread::sleep_for(20ms);
  }
  return lock;
}

/// Keeps it, and logs it, if it says anything new. The table has a line for each.
void TakeWarning(Job* job, std::string text) {
  constexpr size_t kMaxBytes = 1000;
  text = wire::Printable(text, kMaxBytes);
  if (job->warnings.size() >= kMaxWarnings ||
      std::find(job->warnings.begin(), job->warnings.end(), text) != job->warnings.end()) {
    return;
  }
  if (job->warnings.size() + 1 == kMaxWarnings) {
    text = "further warnings are left out";
  }
  spdlog::warn("job {}: {}", job->id, text);
  job->warnings.push_back(std::move(text));
}

}  // namespace

StatusOr<std::unique_ptr<JobRunner>> JobRunner::Open(const RunnerOptions& asked) {
  RunnerOptions options = asked;
  FOVEA_RETURN_IF_ERROR(MakeCanonical(&options.folders));
  std::error_code error;
  if (fs::create_directories(options.state, error)) {
    fs::permissions(options.state, fs::perms::owner_all, error);
  }
  if (error) {
    return FailedPrecondition("--state: '{}' cannot be made: {}", options.state, error.message());
  }
  FOVEA_ASSIGN_OR_RETURN(const int lock, LockFolder(options.state, options.lock_limit));
  auto table = JobTable::Open(options.state + "/jobs.sqlite");
  if (!table.ok()) {
    ::close(lock);
    return Annotate(table.status(), "--state");
  }
  auto runner =
      std::unique_ptr<JobRunner>(new JobRunner(std::move(options), lock, *std::move(table)));
  FOVEA_RETURN_IF_ERROR(runner->TakeUp());
  return runner;
}

/// Queues what an earlier server left, and begins to work.
Status JobRunner::TakeUp() {
  FOVEA_ASSIGN_OR_RETURN(std::vector<Job> jobs, table_->Unended());
  for (Job& job : jobs) {
    auto live = std::make_unique<Live>();
    live->job = std::move(job);
    live->job.state = State::kQueued;
    queue_.push_back(live.get());
    live_.emplace(live->job.id, std::move(live));
  }
  if (!queue_.empty()) {
    spdlog::info("jobs: {} go on", queue_.size());
  }
  for (int i = 0; i < std::max(1, options_.at_once); ++i) {
    threads_.emplace_back([this] { Work(); });
  }
  return absl::OkStatus();
}

JobRunner::~JobRunner() {
  Stop();
  ::close(lock_);
}

void JobRunner::Stop() {
  std::vector<std::weak_ptr<JobListener>> listeners;
  std::vector<std::thread> threads;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    threads = std::move(threads_);
    threads_.clear();
    for (const auto& [id, live] : live_) {
      listeners.insert(listeners.end(), live->listeners.begin(), live->listeners.end());
      live->listeners.clear();
    }
  }
  changed_.notify_all();
  for (const auto& listener : listeners) {
    if (const auto alive = listener.lock()) {
      alive->OnClosing();
    }
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

StatusOr<Job> JobRunner::Create(Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (std::ssize(live_) >= kMaxUnended) {
      return ResourceExhausted(
          "{} jobs have not ended, the most that a server keeps; ask again "
          "when some have",
          kMaxUnended);
    }
  }
  job.id = NewId();
  job.state = State::kQueued;
  job.created_ms = NowMs();
  FOVEA_RETURN_IF_ERROR(table_->Insert(&job));
  if (const Status pruned = table_->Prune(kMaxEnded); !pruned.ok()) {
    spdlog::warn("jobs: {}", MessageOf(pruned));
  }
  {
    const std::lock_guard lock(mutex_);
    auto live = std::make_unique<Live>();
    live->job = job;
    queue_.push_back(live.get());
    live_.emplace(job.id, std::move(live));
  }
  changed_.notify_one();
  return job;
}

StatusOr<Job> JobRunner::Get(const std::string& owner, const std::string& id) {
  {
    const std::lock_guard lock(mutex_);
    const auto live = live_.find(id);
    if (live != live_.end() && live->second->job.owner == owner) {
      return live->second->job;
    }
  }
  return Find(owner, id);
}

StatusOr<Job> JobRunner::Find(const std::string& owner, const std::string& id) {
  auto job = table_->Get(id);
  return job.ok() && job->owner != owner ? NotFound("there is no job '{}'", id) : job;
}

StatusOr<std::vector<Job>> JobRunner::List(const std::string& owner, int64_t before,
                                           int64_t limit) {
  FOVEA_ASSIGN_OR_RETURN(std::vector<Job> jobs, table_->List(owner, before, limit));
  const std::lock_guard lock(mutex_);
  for (Job& job : jobs) {
    if (const auto live = live_.find(job.id); live != live_.end()) {
      job = live->second->job;
    }
  }
  return jobs;
}

std::optional<Job> JobRunner::UnendedOn(const std::string& dataset) {
  const std::lock_guard lock(mutex_);
  const auto live = std::find_if(live_.begin(), live_.end(), [&](const auto& entry) {
    return entry.second->job.dataset == dataset && !IsEnd(entry.second->job.state);
  });
  return live == live_.end() ? std::nullopt : std::optional(live->second->job);
}

StatusOr<Job> JobRunner::Cancel(const std::string& owner, const std::string& id) {
  std::unique_lock lock(mutex_);
  const auto found = live_.find(id);
  if (found == live_.end() || found->second->job.owner != owner) {
    lock.unlock();
    return Find(owner, id);
  }
  Live* live = found->second.get();
  live->cancelled = true;
  const auto queued = std::find(queue_.begin(), queue_.end(), live);
  if (queued == queue_.end()) {
    return live->job;
  }
  queue_.erase(queued);
  lock.unlock();
  Attempt attempt;
  Finish(live, Cancelled("cancelled before it began"), &attempt);
  return Get(owner, id);
}

Status JobRunner::Watch(const std::string& owner, const std::string& id,
                        std::weak_ptr<JobListener> listener) {
  Job job;
  bool closing = false;
  {
    const std::lock_guard lock(mutex_);
    const auto live = live_.find(id);
    if (live != live_.end() && live->second->job.owner == owner) {
      job = live->second->job;
      closing = stopping_;
      if (!closing) {
        live->second->listeners.push_back(listener);
      }
    }
  }
  if (job.id.empty()) {
    FOVEA_ASSIGN_OR_RETURN(job, Find(owner, id));
  }
  if (const auto alive = listener.lock()) {
    alive->OnJob(job);
    if (closing) {
      alive->OnClosing();
    }
  }
  return absl::OkStatus();
}

JobRunner::Counts JobRunner::counts() {
  const std::lock_guard lock(mutex_);
  Counts counts = ended_;
  counts.queued = std::ssize(queue_);
  counts.running = std::ssize(live_) - counts.queued;
  return counts;
}

void JobRunner::Work() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (queue_.empty()) {
      changed_.wait(lock);
      continue;
    }
    Live* live = queue_.front();
    queue_.pop_front();
    lock.unlock();
    RunOne(live);
    lock.lock();
  }
}

void JobRunner::RunOne(Live* live) {
  Attempt attempt;
  {
    const std::lock_guard lock(mutex_);
    Job& job = live->job;
    job.state = State::kRunning;
    job.started_ms = job.started_ms.value_or(NowMs());
    job.progress.failed = 0;
    job.failures.clear();
  }
  Save(*live, &attempt);
  Tell(live);
  spdlog::info("job {}: runs for dataset '{}'", live->job.id, live->job.dataset);
  const auto process =
      JobProcess::Start(live->job, {options_.folders, options_.threads, lock_, options_.program});
  if (!process.ok()) {
    Finish(live, process.status(), &attempt);
    return;
  }
  const Status status = Attend(live, process->get(), &attempt);
  Finish(live, status, &attempt);
}

JobRunner::Wish JobRunner::WishFor(const Live& live) {
  const std::lock_guard lock(mutex_);
  return live.cancelled ? Wish::kCancel : stopping_ ? Wish::kStop : Wish::kGoOn;
}

/// Until the process has ended: how the job did.
Status JobRunner::Attend(Live* live, JobProcess* process, Attempt* attempt) {
  while (true) {
    const std::vector<Report> reports = process->Wait(kPollInterval);
    TakeReports(live, reports, attempt);
    const auto* end = reports.empty() ? nullptr : std::get_if<EndReport>(&reports.back());
    if (end != nullptr) {
      return attempt->was_killed && !end->status.ok() ? Cancelled("cancelled") : end->status;
    }
    const Wish wish = WishFor(*live);
    const auto now = Clock::now();
    if (wish != Wish::kGoOn && !attempt->was_asked) {
      attempt->was_asked = true;
      attempt->asked_to_stop = now;
      process->AskToStop();
    } else if (attempt->was_asked && !attempt->was_killed &&
               now - attempt->asked_to_stop > (wish == Wish::kCancel ? kCancelGrace : kStopGrace)) {
      attempt->was_killed = true;
      process->Kill();
    }
  }
}

void JobRunner::TakeReports(Live* live, const std::vector<Report>& reports, Attempt* attempt) {
  const auto now = Clock::now();
  {
    const std::lock_guard lock(mutex_);
    Job& job = live->job;
    for (const Report& report : reports) {
      if (const auto* progress = std::get_if<ProgressReport>(&report)) {
        job.now = progress->now;
        if (progress->total > 0) {
          job.progress.done = progress->done;
          job.progress.total = progress->total;
        }
        if (attempt->done_before < 0 && progress->total > 0) {
          attempt->done_before = progress->done;
          attempt->first_progress = now;
        }
      } else if (const auto* failure = std::get_if<Failure>(&report)) {
        ++job.progress.failed;
        if (job.failures.size() < kMaxFailures) {
          job.failures.push_back(*failure);
        }
      } else if (const auto* warning = std::get_if<WarningReport>(&report)) {
        TakeWarning(&job, warning->text);
      }
    }
    const int64_t made = job.progress.done - attempt->done_before;
    job.seconds_left.reset();
    if (attempt->done_before >= 0 && made > 0) {
      const std::chrono::duration<double> passed = now - attempt->first_progress;
      const int64_t left = job.progress.total - job.progress.done - job.progress.failed;
      job.seconds_left = passed.count() * static_cast<double>(std::max<int64_t>(left, 0)) /
                         static_cast<double>(made);
    }
  }
  attempt->is_told &= reports.empty();
  attempt->is_saved &= reports.empty();
  if (!attempt->is_told && now - attempt->told >= kTellInterval) {
    attempt->is_told = true;
    attempt->told = now;
    Tell(live);
  }
  if (!attempt->is_saved && now - attempt->saved >= kSaveInterval) {
    attempt->is_saved = true;
    Save(*live, attempt);
  }
}

/// The end of an attempt, which is the job's unless the server stops.
void JobRunner::Finish(Live* live, const Status& status, Attempt* attempt) {
  if (!attempt->is_told) {  // its end is told once it is written, which may take a while
    Tell(live);
  }
  bool goes_on = false;
  {
    const std::lock_guard lock(mutex_);
    goes_on = absl::IsCancelled(status) && !live->cancelled;
  }
  if (!goes_on && absl::IsCancelled(status)) {
    Tidy(live->job);
  }
  if (!goes_on && live->job.kind == Kind::kIngestFiles && options_.on_made) {
    options_.on_made(live->job.dataset);
  }
  {
    const std::lock_guard lock(mutex_);
    Job& job = live->job;
    job.now.clear();
    job.seconds_left.reset();
    job.state = goes_on                     ? State::kQueued
                : status.ok()               ? State::kDone
                : absl::IsCancelled(status) ? State::kCancelled
                                            : State::kFailed;
    if (job.state == State::kFailed) {
      job.message = std::string(MessageOf(status));
    }
    if (!goes_on) {
      job.ended_ms = NowMs();
    }
  }
  spdlog::info("job {}: {}{}{}", live->job.id,
               goes_on ? "stopped, and goes on at the next start" : "ended: ",
               goes_on ? "" : absl::StatusCodeToString(status.code()),
               status.ok() || goes_on ? "" : fmt::format(": {}", MessageOf(status)));
  Save(*live, attempt);
  Tell(live);
  const std::lock_guard lock(mutex_);
  if (!goes_on) {
    ++(status.ok() ? ended_.done : absl::IsCancelled(status) ? ended_.cancelled : ended_.failed);
    live_.erase(live->job.id);
  }
}

/// A store without a step is nothing that was finished: it goes with the ingest that was cancelled.
void JobRunner::Tidy(const Job& job) const {
  if (job.kind != Kind::kIngestFiles) {
    return;
  }
  const std::string path = DatasetPath(options_.folders, job.dataset);
  std::error_code ignored;
  if (!fs::exists(fs::path(path) / store::kLockName, ignored)) {
    return;  // no store, and no beginning of one
  }
  // Whoever has the writer's lock writes to it now; else it is ours, and let go of last.
  const auto writer = store::DatasetWriter::Append(path);
  if (writer.ok()) {
    if ((*writer)->info().committed_steps == 0) {
      [[maybe_unused]] const Status removed = store::RemoveHeldStore(path);
    }
    return;
  }
  const auto lock = store::WriterLock::Take(store::RealFileSystem(), path);
  if (lock.ok() && !fs::exists(fs::path(path) / store::kMetadataName, ignored)) {
    [[maybe_unused]] const Status removed = store::RemoveHeldStore(path);
  }
}

/// Tries for as long as it takes where an end cannot be written: a full disk may have room again.
void JobRunner::Save(const Live& live, Attempt* attempt) {
  attempt->saved = Clock::now();
  Status status;
  bool is_told = false;
  while (true) {
    status = table_->Update(live.job, attempt->saved_failures);
    if (status.ok()) {
      attempt->saved_failures = live.job.failures.size();
      return;
    }
    if (!std::exchange(is_told, true)) {
      spdlog::warn("job {}: how it stands cannot be written: {}", live.job.id, MessageOf(status));
    }
    std::unique_lock lock(mutex_);
    if (!IsEnd(live.job.state) || stopping_) {
      return;
    }
    changed_.wait_for(lock, kSaveInterval, [this] { return stopping_; });
  }
}

void JobRunner::Tell(Live* live) {
  Job job;
  std::vector<std::shared_ptr<JobListener>> listeners;
  {
    const std::lock_guard lock(mutex_);
    job = live->job;
    auto& all = live->listeners;
    for (const auto& listener : all) {
      if (auto alive = listener.lock()) {
        listeners.push_back(std::move(alive));
      }
    }
    std::erase_if(all, [](const auto& listener) { return listener.expired(); });
  }
  for (const auto& listener : listeners) {
    listener->OnJob(job);
  }
}

}  // namespace fovea::jobs
