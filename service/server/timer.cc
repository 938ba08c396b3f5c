#include "service/server/timer.h"

#include <utility>

namespace fovea::server {

Timer::Timer() {
  thread_ = std::thread([this] { Run(); });
}

Timer::~Timer() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Timer::After(Clock::duration delay, std::function<void()> job) {
  {
    const std::lock_guard lock(mutex_);
    jobs_.emplace(Clock::now() + delay, std::move(job));
  }
  changed_.notify_all();
}

void Timer::Run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (jobs_.empty()) {
      changed_.wait(lock);
    } else if (const auto due = jobs_.begin()->first; due > Clock::now()) {
      changed_.wait_until(lock, due);
    } else {
      std::function<void()> job = std::move(jobs_.extract(jobs_.begin()).mapped());
      lock.unlock();
      job();
      job = nullptr;  // what it holds goes outside the lock
      lock.lock();
    }
  }
}

}  // namespace fovea::server
