#include "service/server/work_pool.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "service/wire/status.h"

namespace fovea::server {

WorkPool::WorkPool(Limits limits) : limits_(std::move(limits)) {
  threads_.reserve(static_cast<size_t>(limits_.threads));
  for (int i = 0; i < limits_.threads; ++i) {
    threads_.emplace_back([this] { Run(); });
  }
}

WorkPool::~WorkPool() {
  {
    std::deque<Entry> dropped;  // destroyed without the lock: a job may own whatever it likes
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    dropped.swap(waiting_);
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) {
    thread.join();
  }
}

StatusOr<WorkPool::Ticket> WorkPool::Submit(int64_t bytes, Job job) {
  const std::lock_guard lock(mutex_);
  if (static_cast<int64_t>(waiting_.size()) >= limits_.max_waiting) {
    ++refused_;
    constexpr auto kRetry = std::chrono::seconds(1);
    return wire::WithRetry(
        ResourceExhausted("the {} is full: {} calls wait already{}; try again later", limits_.name,
                          limits_.max_waiting,
                          limits_.flag.empty() ? "" : " (" + limits_.flag + ")"),
        kRetry);
  }
  return Push(bytes, std::move(job));
}

WorkPool::Ticket WorkPool::SubmitAdmitted(int64_t bytes, Job job) {
  const std::lock_guard lock(mutex_);
  return Push(bytes, std::move(job));
}

WorkPool::Ticket WorkPool::Push(int64_t bytes, Job job) {
  waiting_.push_back({++last_ticket_, bytes, std::move(job)});
  changed_.notify_one();
  return last_ticket_;
}

bool WorkPool::Remove(Ticket ticket) {
  Entry removed;  // destroyed without the lock
  {
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                    [&](const Entry& entry) { return entry.ticket == ticket; });
    if (found == waiting_.end()) {
      return false;
    }
    removed = std::move(*found);
    waiting_.erase(found);
  }
  changed_.notify_all();  // what comes next may need less memory than what was removed
  return true;
}

WorkPool::Counts WorkPool::counts() {
  const std::lock_guard lock(mutex_);
  return {static_cast<int64_t>(waiting_.size()), running_, running_bytes_, refused_};
}

bool WorkPool::MayStart() const {
  return !waiting_.empty() &&
         (running_ == 0 || waiting_.front().bytes <= limits_.max_running_bytes - running_bytes_);
}

void WorkPool::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopping_ || MayStart(); });
    if (stopping_) {
      return;
    }
    Entry entry = std::move(waiting_.front());
    waiting_.pop_front();
    ++running_;
    running_bytes_ += entry.bytes;
    const int share = std::max(1, limits_.threads / running_);
    lock.unlock();
    entry.job(share);
    entry.job = nullptr;
    lock.lock();
    --running_;
    running_bytes_ -= entry.bytes;
    changed_.notify_all();
  }
}

}  // namespace fovea::server
