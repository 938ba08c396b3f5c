#ifndef ENGINE_STORE_ENCODER_POOL_H_
#define ENGINE_STORE_ENCODER_POOL_H_

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "engine/store/codec.h"

namespace fovea::store {

/// Encoders that are used again and again, as many as threads ever encoded at once: to make one
/// costs more than to encode a chunk. Thread-safe.
class EncoderPool {
 public:
  /// An encoder for one thread, given back when this goes.
  class Loan {
   public:
    Loan(EncoderPool* pool, std::unique_ptr<Encoder> encoder)
        : pool_(pool), encoder_(std::move(encoder)) {}
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;
    ~Loan() { pool_->GiveBack(std::move(encoder_)); }
    Encoder* operator->() const { return encoder_.get(); }

   private:
    EncoderPool* pool_;
    std::unique_ptr<Encoder> encoder_;
  };

  [[nodiscard]] Loan Borrow() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) {
      return {this, std::make_unique<Encoder>()};
    }
    std::unique_ptr<Encoder> encoder = std::move(idle_.back());
    idle_.pop_back();
    return {this, std::move(encoder)};
  }

 private:
  void GiveBack(std::unique_ptr<Encoder> encoder) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(encoder));
  }

  std::mutex mutex_;
  std::vector<std::unique_ptr<Encoder>> idle_;  // guarded by mutex_
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_ENCODER_POOL_H_
