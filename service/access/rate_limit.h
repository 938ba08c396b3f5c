#ifndef SERVICE_ACCESS_RATE_LIMIT_H_
#define SERVICE_ACCESS_RATE_LIMIT_H_

#include <chrono>
#include <mutex>
#include <optional>

namespace fovea::access {

/// How much a second, over time: a token bucket that holds one second's worth. What is asked for is
/// given whole while anything is left, also when it is more than that; what follows then waits
/// until the debt is paid. Thread-safe.
class RateLimit {
 public:
  using Clock = std::chrono::steady_clock;

  /// `per_second` above 0; 0: no limit.
  explicit RateLimit(double per_second, Clock::time_point now = Clock::now())
      : per_second_(per_second), left_(per_second), at_(now) {}

  /// Takes `amount`, at least 0; or takes nothing, and says how long to wait.
  [[nodiscard]] std::optional<std::chrono::milliseconds> Take(double amount,
                                                              Clock::time_point now = Clock::now());

  /// Takes `amount` whatever is left: for what has come already. How long until something is left
  /// again; 0: there is.
  [[nodiscard]] std::chrono::milliseconds Spend(double amount,
                                                Clock::time_point now = Clock::now());
  /// What was taken and not used after all.
  void GiveBack(double amount);

  [[nodiscard]] double per_second() const { return per_second_; }

 private:
  // Both with mutex_ held.
  void Refill(Clock::time_point now);
  [[nodiscard]] std::chrono::milliseconds Wait() const;

  const double per_second_;
  std::mutex mutex_;
  double left_;           // guarded by mutex_
  Clock::time_point at_;  // guarded by mutex_; when left_ was right
};

}  // namespace fovea::access

#endif  // SERVICE_ACCESS_RATE_LIMIT_H_
