#ifndef SERVICE_SERVER_CALL_TRACKER_H_
#define SERVICE_SERVER_CALL_TRACKER_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

namespace fovea::server {

/// Counts the calls that run, so that a server can stop taking new ones and wait for the rest.
/// Thread-safe; must outlive its slots.
class CallTracker {
 public:
  /// One running call. Movable; a default one stands for none.
  class Slot {
   public:
    Slot() = default;
    Slot(Slot&& other) noexcept : tracker_(std::exchange(other.tracker_, nullptr)) {}
    Slot& operator=(Slot&& other) noexcept {
      std::swap(tracker_, other.tracker_);
      return *this;
    }
    ~Slot() {
      if (tracker_ != nullptr) {
        tracker_->Leave();
      }
    }

   private:
    friend class CallTracker;
    explicit Slot(CallTracker* tracker) : tracker_(tracker) {}
    CallTracker* tracker_ = nullptr;
  };

  /// Empty once the server drains.
  [[nodiscard]] std::optional<Slot> Enter() {
    const std::lock_guard lock(mutex_);
    if (draining_) {
      return std::nullopt;
    }
    ++running_;
    return Slot(this);
  }

  /// From now on Enter returns nothing.
  void StopAdmitting() {
    const std::lock_guard lock(mutex_);
    draining_ = true;
  }

  [[nodiscard]] bool draining() {
    const std::lock_guard lock(mutex_);
    return draining_;
  }

  /// Waits until no call runs, or for `limit`; returns how many still do.
  int64_t WaitIdle(std::chrono::milliseconds limit) {
    std::unique_lock lock(mutex_);
    left_.wait_for(lock, limit, [this] { return running_ == 0; });
    return running_;
  }

 private:
  void Leave() {
    const std::lock_guard lock(mutex_);
    --running_;
    left_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable left_;
  // Both guarded by mutex_.
  int64_t running_ = 0;
  bool draining_ = false;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_CALL_TRACKER_H_
