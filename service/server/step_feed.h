#ifndef SERVICE_SERVER_STEP_FEED_H_
#define SERVICE_SERVER_STEP_FEED_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "service/server/catalogue.h"
#include "service/server/file_watch.h"

namespace fovea::server {

/// What there is of a dataset.
struct DatasetNews {
  std::shared_ptr<ServedDataset> dataset;  // null: it is not there, or cannot be opened
  int64_t committed_steps = 0;
  Status error;          // why there is no dataset
  bool closing = false;  // the server shuts down: nothing more will come
};

/// One who wants to know of the steps of a dataset.
class StepListener {
 public:
  virtual ~StepListener() = default;
  /// How things stand: first soon after Subscribe, then after each change, in order. What comes
  /// between two calls is in the second. From the feed's thread: must not wait. Ends with
  /// `closing`.
  virtual void OnNews(const DatasetNews& news) = 0;
};

/// Notices new steps of the datasets that somebody listens to, whoever commits them: a thread looks
/// at the metadata of each (one `stat`) every `interval`, and reads it when it has changed.
/// Looking, and not inotify, because that sees nothing on network file systems; what this process
/// commits is told of at once (Poke). Costs nothing while nobody listens. Thread-safe.
class StepFeed {
 public:
  static constexpr std::chrono::milliseconds kInterval{20};
  /// Between walks over the root for datasets that are not there.
  static constexpr std::chrono::milliseconds kAbsentInterval{1000};

  /// `catalogue` must outlive it.
  StepFeed(Catalogue& catalogue, std::chrono::milliseconds interval,
           std::chrono::milliseconds absent_interval);
  ~StepFeed();
  StepFeed(const StepFeed&) = delete;
  StepFeed& operator=(const StepFeed&) = delete;

  /// Until the listener is gone. May be called from OnNews.
  void Subscribe(const std::string& dataset, std::weak_ptr<StepListener> listener);
  /// This dataset has changed: look now.
  void Poke(const std::string& dataset);
  /// Tells every listener, of now and later, that the server shuts down.
  void Close();

  /// How often metadata was read, for tests and measurements.
  [[nodiscard]] int64_t looks() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Listeners = std::vector<std::weak_ptr<StepListener>>;
  struct Topic {
    Listeners listeners, newcomers;
    bool poked = true;
  };
  /// What was seen last of a topic; the thread's own.
  struct Sight {
    DatasetNews news;
    std::vector<FileWatch::Seen> seen;
    Clock::time_point looked;
  };

  void Run();
  void Visit(const std::string& name);
  /// Whether the dataset may be other than it was.
  [[nodiscard]] bool MayHaveChanged(const Sight& sight) const;
  /// True if it is.
  [[nodiscard]] bool Look(const std::string& name, Sight* sight);
  static void Tell(const Listeners& listeners, const DatasetNews& news);

  Catalogue& catalogue_;
  const std::chrono::milliseconds interval_, absent_interval_;
  std::map<std::string, Sight> sights_;  // the thread's own

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // All below: guarded by mutex_.
  std::map<std::string, Topic> topics_;
  bool poked_ = false;  // any topic is
  bool closing_ = false, stopping_ = false;
  int64_t looks_ = 0;
  std::thread thread_;  // written by the constructor only
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_STEP_FEED_H_
