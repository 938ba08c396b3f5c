#ifndef SERVICE_SERVER_WORK_POOL_H_
#define SERVICE_SERVER_WORK_POOL_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "engine/base/status.h"

namespace fovea::server {

/// A fixed number of threads and a bounded queue in front of them: gRPC's own threads hand work
/// over here and never wait. Clients take turns: each has a line of its own, first come, first
/// served, and a thread that is free takes the first of the next client's line. Thread-safe.
class WorkPool {
 public:
  struct Limits {
    std::string name;                       // in errors: "render queue"
    std::string flag;                       // in errors: what raises `max_waiting`; may be empty
    int threads = 1;                        // at least 1
    int max_waiting = 64;                   // jobs of Submit that wait, of all clients
    int64_t max_running_bytes = INT64_MAX;  // of the jobs that run
  };
  /// `threads` is the job's share of the pool's threads, at least 1.
  using Job = std::function<void(int threads)>;
  using Ticket = uint64_t;
  struct Counts {
    int64_t waiting = 0, running = 0;
    int64_t running_bytes = 0;
    uint64_t refused = 0;  // since the start
  };

  explicit WorkPool(Limits limits);
  [[nodiscard]] int threads() const { return limits_.threads; }
  /// Drops what waits, and returns when what runs is done.
  ~WorkPool();
  WorkPool(const WorkPool&) = delete;
  WorkPool& operator=(const WorkPool&) = delete;

  /// RESOURCE_EXHAUSTED, naming the limit, with RetryInfo, unless more places are free than jobs of
  /// `client` wait: one alone may fill half of the queue, and a newcomer finds a place. `bytes` is
  /// the memory that the job will use; above max_running_bytes it can never run, and is refused
  /// without RetryInfo.
  [[nodiscard]] StatusOr<Ticket> Submit(int64_t bytes, Job job, const std::string& client = "");
  /// What Submit would say of a small job now: refuses early what would be refused after all.
  [[nodiscard]] Status CheckRoom(const std::string& client);
  /// Whether it refused anything in the last second.
  [[nodiscard]] bool IsCrowded();
  /// For the next piece of something that was admitted before: never refused. Runs alone if it
  /// needs more than max_running_bytes.
  Ticket SubmitAdmitted(int64_t bytes, Job job, const std::string& client = "");
  /// Whether the job was still waiting; it is dropped then, and never runs.
  bool Remove(Ticket ticket);

  [[nodiscard]] const Limits& limits() const { return limits_; }
  [[nodiscard]] Counts counts();

 private:
  struct Entry {
    Ticket ticket = 0;
    int64_t bytes = 0;
    Job job;
  };

  void Run();
  // All four with mutex_ held.
  [[nodiscard]] Status CheckPlace(const std::string& client);
  [[nodiscard]] bool MayStart() const;
  [[nodiscard]] Entry TakeNext();
  Ticket Push(const std::string& client, int64_t bytes, Job job);

  const Limits limits_;
  std::mutex mutex_;
  std::condition_variable changed_;
  // All below: guarded by mutex_.
  std::map<std::string, std::deque<Entry>> lines_;  // by client; none is empty
  std::deque<std::string> turns_;                   // the clients of lines_; the first is next
  int64_t waiting_ = 0;                             // in all lines
  Ticket last_ticket_ = 0;
  int running_ = 0;
  int64_t running_bytes_ = 0;
  uint64_t refused_ = 0;
  std::chrono::steady_clock::time_point refused_at_;  // the last time, if refused_ > 0
  bool stopping_ = false;
  std::vector<std::thread> threads_;  // written by the constructor only
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_WORK_POOL_H_
