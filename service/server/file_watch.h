#ifndef SERVICE_SERVER_FILE_WATCH_H_
#define SERVICE_SERVER_FILE_WATCH_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace fovea::server {

/// Looks at some files again and again, in a thread of its own, and calls back when one of them was
/// written, replaced, removed, or is another behind a link. Thread-safe.
class FileWatch {
 public:
  /// What tells a file from what it was.
  struct Seen {
    uint64_t device = 0, inode = 0, bytes = 0;  // 0 if it is not there
    int64_t changed_ns = 0;
    friend bool operator==(const Seen&, const Seen&) = default;
  };
  [[nodiscard]] static std::vector<Seen> Look(const std::vector<std::string>& paths);

  /// `seen` is from before the files were read last: what changed since is not missed.
  FileWatch(std::vector<std::string> paths, std::vector<Seen> seen,
            std::chrono::milliseconds interval, std::function<void()> on_change);
  /// When it returns, `on_change` is not called any more.
  ~FileWatch();
  FileWatch(const FileWatch&) = delete;
  FileWatch& operator=(const FileWatch&) = delete;

 private:
  void Run();

  const std::vector<std::string> paths_;
  const std::chrono::milliseconds interval_;
  const std::function<void()> on_change_;
  std::vector<Seen> seen_;  // the thread's
  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopping_ = false;  // guarded by mutex_
  std::thread thread_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_FILE_WATCH_H_
