#include "service/server/file_watch.h"

#include <sys/stat.h>

#include <utility>

namespace fovea::server {

std::vector<FileWatch::Seen> FileWatch::Look(const std::vector<std::string>& paths) {
  std::vector<Seen> seen;
  for (const std::string& path : paths) {
    struct stat info {};
    if (::stat(path.c_str(), &info) != 0) {
      seen.emplace_back();
      continue;
    }
    seen.push_back({info.st_dev, info.st_ino, static_cast<uint64_t>(info.st_size),
                    info.st_ctim.tv_sec * int64_t{1'000'000'000} + info.st_ctim.tv_nsec});
  }
  return seen;
}

FileWatch::FileWatch(std::vector<std::string> paths, std::vector<Seen> seen,
                     std::chrono::milliseconds interval, std::function<void()> on_change)
    : paths_(std::move(paths)),
      interval_(interval),
      on_change_(std::move(on_change)),
      seen_(std::move(seen)),
      thread_([this] { Run(); }) {}

FileWatch::~FileWatch() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stop_.notify_all();
  thread_.join();
}

void FileWatch::Run() {
  std::unique_lock lock(mutex_);
  while (!stop_.wait_for(lock, interval_, [this] { return stopping_; })) {
    lock.unlock();
    std::vector<Seen> now = Look(paths_);
    if (now != seen_) {
      seen_ = std::move(now);
      on_change_();
    }
    lock.lock();
  }
}

}  // namespace fovea::server
