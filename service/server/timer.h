#ifndef SERVICE_SERVER_TIMER_H_
#define SERVICE_SERVER_TIMER_H_

#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

namespace fovea::server {

/// Calls back later, in order of time, on one thread of its own. Thread-safe.
class Timer {
 public:
  using Clock = std::chrono::steady_clock;

  Timer();
  /// What has not come by then is dropped.
  ~Timer();
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

  /// `job` must not wait. May be called from a job.
  void After(Clock::duration delay, std::function<void()> job);

 private:
  void Run();

  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::multimap<Clock::time_point, std::function<void()>> jobs_;
  bool stopping_ = false;
  std::thread thread_;  // written by the constructor only
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_TIMER_H_
