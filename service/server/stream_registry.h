#ifndef SERVICE_SERVER_STREAM_REGISTRY_H_
#define SERVICE_SERVER_STREAM_REGISTRY_H_

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "engine/base/status.h"

namespace fovea::server {

/// A running stream as an acknowledgement sees it.
class AcknowledgedStream {
 public:
  virtual ~AcknowledgedStream() = default;
  /// Every frame up to `index` was shown. INVALID_ARGUMENT if that one was not sent yet.
  virtual Status Acknowledge(uint64_t index) = 0;
};

/// Running streams by the id that their clients chose. Each owner (a token's name) has ids of its
/// own: nobody learns of another's. Thread-safe.
class StreamRegistry {
 public:
  /// ALREADY_EXISTS if a stream of this id runs.
  [[nodiscard]] Status Add(const std::string& owner, const std::string& id,
                           std::weak_ptr<AcknowledgedStream> stream) {
    const std::lock_guard lock(mutex_);
    if (!streams_.emplace(Key(owner, id), std::move(stream)).second) {
      return AlreadyExists("stream_id '{}': a stream of this id is running; choose a random one",
                           id);
    }
    return absl::OkStatus();
  }

  void Remove(const std::string& owner, const std::string& id) {
    const std::lock_guard lock(mutex_);
    streams_.erase(Key(owner, id));
  }

  /// Null if there is none.
  [[nodiscard]] std::shared_ptr<AcknowledgedStream> Find(const std::string& owner,
                                                         const std::string& id) {
    const std::lock_guard lock(mutex_);
    const auto found = streams_.find(Key(owner, id));
    return found == streams_.end() ? nullptr : found->second.lock();
  }

 private:
  using Key = std::pair<std::string, std::string>;  // owner, id
  std::mutex mutex_;
  std::map<Key, std::weak_ptr<AcknowledgedStream>> streams_;  // guarded by mutex_
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_STREAM_REGISTRY_H_
