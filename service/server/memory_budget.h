#ifndef SERVICE_SERVER_MEMORY_BUDGET_H_
#define SERVICE_SERVER_MEMORY_BUDGET_H_

#include <chrono>
#include <cstdint>
#include <mutex>
#include <utility>

#include "engine/base/status.h"
#include "service/wire/status.h"

namespace fovea::server {

/// One part of the memory that a server may take (MemoryPlan): what is reserved is free for others
/// only when it is given back. Thread-safe; must outlive its reservations.
class MemoryBudget {
 public:
  /// Bytes set aside, given back when it goes. Movable; a default one holds nothing.
  class Reservation {
   public:
    Reservation() = default;
    Reservation(Reservation&& other) noexcept
        : budget_(std::exchange(other.budget_, nullptr)), bytes_(other.bytes_) {}
    Reservation& operator=(Reservation&& other) noexcept {
      std::swap(budget_, other.budget_);
      std::swap(bytes_, other.bytes_);
      return *this;
    }
    ~Reservation() {
      if (budget_ != nullptr) {
        budget_->Release(bytes_);
      }
    }

   private:
    friend class MemoryBudget;
    Reservation(MemoryBudget* budget, int64_t bytes) : budget_(budget), bytes_(bytes) {}
    MemoryBudget* budget_ = nullptr;
    int64_t bytes_ = 0;
  };

  explicit MemoryBudget(int64_t limit_bytes) : limit_bytes_(limit_bytes) {}

  /// RESOURCE_EXHAUSTED, with the limit and RetryInfo, if less than `bytes` is left.
  [[nodiscard]] StatusOr<Reservation> Reserve(int64_t bytes) {
    const std::lock_guard lock(mutex_);
    if (bytes > limit_bytes_ - used_bytes_) {
      ++refused_;
      constexpr auto kRetry = std::chrono::seconds(1);
      Status full = ResourceExhausted(
          "running calls and what is made and sent for them take {} MiB already, and this one "
          "needs "
          "{} MiB more; the server's limit for that is {} MiB (--memory-limit); try again later, "
          "or "
          "ask for smaller frames",
          used_bytes_ >> 20, (bytes >> 20) + 1, limit_bytes_ >> 20);
      // What can never be had is not worth waiting for.
      return bytes > limit_bytes_ ? full : wire::WithRetry(std::move(full), kRetry);
    }
    used_bytes_ += bytes;
    return Reservation(this, bytes);
  }

  [[nodiscard]] int64_t limit_bytes() const { return limit_bytes_; }
  [[nodiscard]] int64_t used_bytes() {
    const std::lock_guard lock(mutex_);
    return used_bytes_;
  }
  [[nodiscard]] uint64_t refused() {
    const std::lock_guard lock(mutex_);
    return refused_;
  }

 private:
  void Release(int64_t bytes) {
    const std::lock_guard lock(mutex_);
    used_bytes_ -= bytes;
  }

  const int64_t limit_bytes_;
  std::mutex mutex_;
  int64_t used_bytes_ = 0;  // guarded by mutex_
  uint64_t refused_ = 0;    // likewise
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_MEMORY_BUDGET_H_
