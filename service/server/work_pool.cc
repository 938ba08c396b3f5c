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
    std::map<std::string, std::deque<Entry>> dropped;  // without the lock: jobs own what they like
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    dropped.swap(lines_);
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) {
    thread.join();
  }
}

StatusOr<WorkPool::Ticket> WorkPool::Submit(int64_t bytes, Job job, const std::string& client) {
  const std::lock_guard lock(mutex_);
  if (bytes > limits_.max_running_bytes) {
    ++refused_;
    return ResourceExhausted(
        "this call needs {} MiB of memory while it is worked on, and this server has {} for all of "
        "them (--memory-limit); ask for a lower rate or a smaller picture",
        (bytes >> 20) + 1, limits_.max_running_bytes >> 20);
  }
  FOVEA_RETURN_IF_ERROR(CheckPlace(client));
  return Push(client, bytes, std::move(job));
}

Status WorkPool::CheckRoom(const std::string& client) {
  const std::lock_guard lock(mutex_);
  return CheckPlace(client);
}

bool WorkPool::IsCrowded() {
  const std::lock_guard lock(mutex_);
  return refused_ > 0 && std::chrono::steady_clock::now() - refused_at_ < std::chrono::seconds(1);
}

Status WorkPool::CheckPlace(const std::string& client) {
  constexpr auto kRetry = std::chrono::seconds(1);
  const auto line = lines_.find(client);
  const int64_t mine = line == lines_.end() ? 0 : static_cast<int64_t>(line->second.size());
  if (mine < limits_.max_waiting - waiting_) {
    return absl::OkStatus();
  }
  ++refused_;
  refused_at_ = std::chrono::steady_clock::now();
  const std::string flag = limits_.flag.empty() ? "" : " (" + limits_.flag + ")";
  if (waiting_ >= limits_.max_waiting) {
    return wire::WithRetry(ResourceExhausted("the {} is full: {} calls wait already{}; try again "
                                             "later",
                                             limits_.name, waiting_, flag),
                           kRetry);
  }
  return wire::WithRetry(
      ResourceExhausted("this client has its share of the {}: {} of its calls wait already, of {} "
                        "in all{}; try again later",
                        limits_.name, mine, waiting_, flag),
      kRetry);
}

WorkPool::Ticket WorkPool::SubmitAdmitted(int64_t bytes, Job job, const std::string& client) {
  const std::lock_guard lock(mutex_);
  return Push(client, bytes, std::move(job));
}

WorkPool::Ticket WorkPool::Push(const std::string& client, int64_t bytes, Job job) {
  std::deque<Entry>& line = lines_[client];
  if (line.empty()) {
    turns_.push_back(client);
  }
  line.push_back({++last_ticket_, bytes, std::move(job)});
  ++waiting_;
  changed_.notify_one();
  return last_ticket_;
}

bool WorkPool::Remove(Ticket ticket) {
  Entry removed;  // destroyed without the lock
  {
    const std::lock_guard lock(mutex_);
    for (auto& [client, line] : lines_) {
      const auto found = std::find_if(line.begin(), line.end(),
                                      [&](const Entry& entry) { return entry.ticket == ticket; });
      if (found != line.end()) {
        removed = std::move(*found);
        line.erase(found);
        --waiting_;
        if (line.empty()) {
          turns_.erase(std::find(turns_.begin(), turns_.end(), client));
          lines_.erase(client);
        }
        break;
      }
    }
  }
  if (removed.ticket == 0) {
    return false;
  }
  changed_.notify_all();  // what comes next may need less memory than what was removed
  return true;
}

WorkPool::Counts WorkPool::counts() {
  const std::lock_guard lock(mutex_);
  return {waiting_, running_, running_bytes_, refused_};
}

bool WorkPool::MayStart() const {
  return !turns_.empty() && (running_ == 0 || lines_.at(turns_.front()).front().bytes <=
                                                  limits_.max_running_bytes - running_bytes_);
}

WorkPool::Entry WorkPool::TakeNext() {
  const auto line = lines_.find(turns_.front());
  Entry entry = std::move(line->second.front());
  line->second.pop_front();
  --waiting_;
  if (line->second.empty()) {
    lines_.erase(line);
  } else {
    turns_.push_back(turns_.front());
  }
  turns_.pop_front();
  return entry;
}

void WorkPool::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopping_ || MayStart(); });
    if (stopping_) {
      return;
    }
    Entry entry = TakeNext();
    ++running_;
    running_bytes_ += entry.bytes;
    // What waits will run beside it on all other threads.
    const int64_t beside = std::min<int64_t>(waiting_, limits_.threads - running_);
    const int share = std::max(1, limits_.threads / (running_ + static_cast<int>(beside)));
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
