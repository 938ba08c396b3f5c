#include "service/server/step_feed.h"

#include <algorithm>
#include <iterator>

namespace fovea::server {
namespace {

/// The file that every commit replaces (docs/formats/store.md).
std::vector<std::string> WatchedPath(ServedDataset& dataset) {
  return {dataset.dataset().path() + "/zarr.json"};
}

}  // namespace

StepFeed::StepFeed(Catalogue& catalogue, std::chrono::milliseconds interval,
                   std::chrono::milliseconds absent_interval)
    : catalogue_(catalogue), interval_(interval), absent_interval_(absent_interval) {
  thread_ = std::thread([this] { Run(); });
}

StepFeed::~StepFeed() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void StepFeed::Subscribe(const std::string& dataset, std::weak_ptr<StepListener> listener) {
  {
    const std::lock_guard lock(mutex_);
    topics_[dataset].newcomers.push_back(std::move(listener));
    poked_ = true;
  }
  changed_.notify_all();
}

void StepFeed::Poke(const std::string& dataset) {
  {
    const std::lock_guard lock(mutex_);
    const auto topic = topics_.find(dataset);
    if (topic == topics_.end()) {
      return;
    }
    topic->second.poked = true;
    poked_ = true;
  }
  changed_.notify_all();
}

void StepFeed::Close() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    poked_ = true;
  }
  changed_.notify_all();
}

int64_t StepFeed::looks() const {
  const std::lock_guard lock(mutex_);
  return looks_;
}

void StepFeed::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    const auto due = [this] { return stopping_ || poked_; };
    if (topics_.empty()) {
      changed_.wait(lock, due);
    } else {
      changed_.wait_for(lock, interval_, due);
    }
    if (stopping_) {
      return;
    }
    poked_ = false;
    std::vector<std::string> names;
    std::transform(topics_.begin(), topics_.end(), std::back_inserter(names),
                   [](const auto& topic) { return topic.first; });
    lock.unlock();
    for (const std::string& name : names) {
      Visit(name);
    }
    lock.lock();
  }
}

void StepFeed::Visit(const std::string& name) {
  Listeners listeners, newcomers;
  bool poked = false, closing = false;
  {
    const std::lock_guard lock(mutex_);
    Topic& topic = topics_.at(name);  // only this thread erases
    const auto gone = [](const auto& listener) { return listener.expired(); };
    std::erase_if(topic.listeners, gone);
    newcomers.swap(topic.newcomers);
    listeners = topic.listeners;
    topic.listeners.insert(topic.listeners.end(), newcomers.begin(), newcomers.end());
    if (topic.listeners.empty()) {
      topics_.erase(name);
      sights_.erase(name);
      return;
    }
    poked = std::exchange(topic.poked, false);
    closing = closing_;
  }
  if (closing) {
    DatasetNews last;
    last.closing = true;
    Tell(listeners, last);
    Tell(newcomers, last);
    return;
  }
  Sight& sight = sights_[name];
  if ((poked || MayHaveChanged(sight)) && Look(name, &sight)) {
    Tell(listeners, sight.news);
  }
  Tell(newcomers, sight.news);
}

bool StepFeed::MayHaveChanged(const Sight& sight) const {
  if (sight.news.dataset == nullptr) {
    return Clock::now() - sight.looked >= absent_interval_;
  }
  return FileWatch::Look(WatchedPath(*sight.news.dataset)) != sight.seen;
}

bool StepFeed::Look(const std::string& name, Sight* sight) {
  // Seen before it is read: what changes in between is looked at again.
  std::vector<FileWatch::Seen> seen;
  if (sight->news.dataset != nullptr) {
    seen = FileWatch::Look(WatchedPath(*sight->news.dataset));
  }
  DatasetNews news;
  auto found = catalogue_.FindNow(name);
  if (found.ok()) {
    news.dataset = *std::move(found);
    news.committed_steps = news.dataset->dataset().info().committed_steps;
  } else {
    news.error = found.status();
  }
  if (news.dataset != sight->news.dataset) {
    seen.clear();  // of another: the next turn looks once more
  }
  const bool changed = news.dataset != sight->news.dataset ||
                       news.committed_steps != sight->news.committed_steps ||
                       news.error != sight->news.error;
  *sight = {std::move(news), std::move(seen), Clock::now()};
  const std::lock_guard lock(mutex_);
  ++looks_;
  return changed;
}

void StepFeed::Tell(const Listeners& listeners, const DatasetNews& news) {
  for (const auto& listener : listeners) {
    if (const auto alive = listener.lock()) {
      alive->OnNews(news);
    }
  }
}

}  // namespace fovea::server
