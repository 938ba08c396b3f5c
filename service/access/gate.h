#ifndef SERVICE_ACCESS_GATE_H_
#define SERVICE_ACCESS_GATE_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "service/access/rate_limit.h"
#include "service/access/token.h"

namespace fovea::access {

/// One who was let in: what its token allows, and what is left of its quotas. The calls of one
/// token share it. Thread-safe.
class Caller {
 public:
  /// One of the streams that a token may have at once; given back when it goes. Movable.
  class Stream {
   public:
    Stream() = default;
    explicit Stream(std::shared_ptr<Caller> caller) : caller_(std::move(caller)) {}
    Stream(Stream&& other) noexcept = default;
    Stream& operator=(Stream&& other) noexcept {
      std::swap(caller_, other.caller_);
      return *this;
    }
    ~Stream() {
      if (caller_ != nullptr) {
        --caller_->streams_;
      }
    }

   private:
    std::shared_ptr<Caller> caller_;
  };

  explicit Caller(Token token);

  /// The token's name; empty for everyone, where a server asks for no tokens.
  [[nodiscard]] const std::string& name() const { return token_.name; }
  [[nodiscard]] const Token& token() const { return token_; }
  /// Whether it may know of this dataset.
  [[nodiscard]] bool Sees(std::string_view dataset) const;
  /// PERMISSION_DENIED without this right.
  [[nodiscard]] Status Check(Right right) const;

  /// These three: RESOURCE_EXHAUSTED with QuotaFailure and RetryInfo above the quota; UNAVAILABLE
  /// once the token was changed or taken away, so that what runs long ends, too.
  [[nodiscard]] Status TakePixels(int64_t pixels);
  [[nodiscard]] Status TakeBytesIn(int64_t bytes);
  [[nodiscard]] static StatusOr<Stream> OpenStream(const std::shared_ptr<Caller>& caller);
  /// Of pixels that were taken and are not rendered.
  void GiveBackPixels(int64_t pixels) { pixels_.GiveBack(static_cast<double>(pixels)); }
  /// For a message of a stream that has come: how long the next one must not be read, so that the
  /// client's transport holds it back. 0: read on. UNAVAILABLE as above.
  [[nodiscard]] StatusOr<std::chrono::milliseconds> SpendBytesIn(int64_t bytes);

  void Revoke() { revoked_ = true; }

 private:
  [[nodiscard]] Status CheckRevoked() const;
  [[nodiscard]] Status Take(RateLimit* limit, double amount, std::string_view unit);

  const Token token_;
  RateLimit pixels_;
  RateLimit bytes_in_;
  std::atomic<int64_t> streams_ = 0;
  std::atomic<bool> revoked_ = false;
};

/// Tells callers by their tokens. Thread-safe.
class Gate {
 public:
  /// With the tokens of this file; of an empty path: everyone may do everything.
  [[nodiscard]] static StatusOr<std::unique_ptr<Gate>> Open(const std::string& token_file);

  /// Reads the file again. An error changes nothing. Callers whose entry is as it was stay as they
  /// are, others are revoked.
  [[nodiscard]] Status Reload();

  /// Who sent these `authorization` values. UNAUTHENTICATED, with nothing of them in the message,
  /// unless it is one "Bearer TOKEN" of a known token.
  [[nodiscard]] StatusOr<std::shared_ptr<Caller>> Identify(
      const std::vector<std::string_view>& authorization) const;

  [[nodiscard]] bool asks_for_tokens() const { return !token_file_.empty(); }
  [[nodiscard]] size_t token_count() const;

 private:
  using Callers = std::vector<std::shared_ptr<Caller>>;
  explicit Gate(std::string token_file) : token_file_(std::move(token_file)) {}

  const std::string token_file_;
  mutable std::mutex mutex_;
  std::shared_ptr<const Callers> callers_;  // guarded by mutex_; what it points at never changes
};

}  // namespace fovea::access

#endif  // SERVICE_ACCESS_GATE_H_
