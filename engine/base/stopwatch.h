#ifndef ENGINE_BASE_STOPWATCH_H_
#define ENGINE_BASE_STOPWATCH_H_

#include <chrono>

namespace fovea {

/// Elapsed wall-clock time on the steady clock, from construction or the last Restart.
class Stopwatch {
 public:
  [[nodiscard]] double ElapsedMs() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }
  /// The time so far in milliseconds; starts again from zero.
  double RestartMs() {
    const double elapsed = ElapsedMs();
    start_ = Clock::now();
    return elapsed;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

}  // namespace fovea

#endif  // ENGINE_BASE_STOPWATCH_H_
