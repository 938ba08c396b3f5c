#ifndef SERVICE_CLIENT_DATASET_WATCH_H_
#define SERVICE_CLIENT_DATASET_WATCH_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace fovea::client {

struct WatchRequest {
  std::string dataset;
  int64_t first_step = 0;  // those that are committed already are told of first
  bool wait = false;       // for a dataset that is not there, instead of NOT_FOUND
};

/// What is new since the event before.
struct DatasetEvent {
  struct Step {
    int64_t step = 0;
    int64_t time_ns = 0;
    std::optional<int64_t> frame_number;
  };
  bool present = false;  // false: it is gone, or not there yet; the next one begins at step 0
  int64_t committed_steps = 0;
  std::vector<Step> steps;
};

/// False ends the watch.
using OnEvent = std::function<bool(const DatasetEvent&)>;
/// Asked every 0.2 s while nothing happens; false ends the watch.
using GoOn = std::function<bool()>;

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_DATASET_WATCH_H_
