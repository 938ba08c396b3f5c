#include "service/access/rate_limit.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace fovea::access {

std::optional<std::chrono::milliseconds> RateLimit::Take(double amount, Clock::time_point now) {
  if (per_second_ <= 0) {
    return std::nullopt;
  }
  const std::lock_guard lock(mutex_);
  Refill(now);
  if (left_ > 0) {
    left_ -= amount;
    return std::nullopt;
  }
  return Wait();
}

std::chrono::milliseconds RateLimit::Spend(double amount, Clock::time_point now) {
  if (per_second_ <= 0) {
    return std::chrono::milliseconds(0);
  }
  const std::lock_guard lock(mutex_);
  Refill(now);
  left_ -= amount;
  return left_ > 0 ? std::chrono::milliseconds(0) : Wait();
}

void RateLimit::GiveBack(double amount) {
  const std::lock_guard lock(mutex_);
  left_ = std::min(per_second_, left_ + amount);
}

void RateLimit::Refill(Clock::time_point now) {
  if (now > at_) {
    const double seconds = std::chrono::duration<double>(now - at_).count();
    left_ = std::min(per_second_, left_ + seconds * per_second_);
    at_ = now;
  }
}

std::chrono::milliseconds RateLimit::Wait() const {
  constexpr double kLongestWaitMs = 365.0 * 86'400 * 1000;
  // A little past the end of the debt, for then something must be left.
  const double wait_ms = std::min(kLongestWaitMs, -left_ / per_second_ * 1000);
  return std::chrono::milliseconds(static_cast<int64_t>(std::floor(wait_ms)) + 1);
}

}  // namespace fovea::access
