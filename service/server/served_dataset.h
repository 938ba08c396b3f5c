#ifndef SERVICE_SERVER_SERVED_DATASET_H_
#define SERVICE_SERVER_SERVED_DATASET_H_

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "service/frames/spec.h"
#include "service/frames/volume_cache.h"
#include "service/wire/dataset_summary.h"

namespace fovea::server {

/// An open store under the name that clients know it by, with what is worth keeping of it. Stays
/// valid for whoever holds it, also when the catalogue has dropped it. Thread-safe.
class ServedDataset {
 public:
  using Clock = std::chrono::steady_clock;

  ServedDataset(std::string name, std::shared_ptr<store::Dataset> dataset,
                std::chrono::milliseconds refresh_interval,
                std::shared_ptr<frames::VolumeCache> volumes = nullptr)
      : name_(std::move(name)),
        dataset_(std::move(dataset)),
        refresh_interval_(refresh_interval),
        volumes_(std::move(volumes)),
        id_(NextId()),
        origin_(OriginOf(*dataset_)),
        refreshed_(Clock::now()) {}

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] store::Dataset& dataset() { return *dataset_; }
  /// Where its frames find the volumes of others.
  [[nodiscard]] frames::SharedVolumes volumes() const { return {volumes_.get(), id_}; }

  /// OK while the store that was opened is the one at its path. NOT_FOUND when it was removed or
  /// replaced, also by one with its very inode. Whoever reads asks this afterwards: what came, data
  /// or an error, may be of what took its place. Two `stat`.
  [[nodiscard]] Status CheckPresent() const;
  /// The catalogue has dropped it: from now on it is not present, whatever is at its path.
  void MarkGone() { gone_ = true; }

  /// Looks for new steps, unless that was done less than the interval ago and need not be `now`.
  [[nodiscard]] Status Refresh(bool now);
  /// frames::DefaultSpec of the steps there are now; computed once per number of steps.
  [[nodiscard]] StatusOr<frames::FrameSpec> DefaultSpec();
  /// What GetDataset returns; if not `whole`, what ListDatasets returns: of many, each must be
  /// short.
  [[nodiscard]] StatusOr<wire::DatasetSummary> Summary(bool whole);

 private:
  static uint64_t NextId() {
    static std::atomic<uint64_t> last = 0;
    return ++last;
  }

  /// The folder, and the metadata of the first field, which is written once, when a store is made:
  /// a folder that was emptied and used again is another store.
  using Origin = std::array<uint64_t, 4>;
  [[nodiscard]] static Origin OriginOf(const store::Dataset& dataset);

  const std::string name_;
  const std::shared_ptr<store::Dataset> dataset_;
  const std::chrono::milliseconds refresh_interval_;
  const std::shared_ptr<frames::VolumeCache> volumes_;  // may be null
  const uint64_t id_;                                   // of no other in this process
  const Origin origin_;
  std::atomic<bool> gone_ = false;

  std::mutex refresh_mutex_;
  Clock::time_point refreshed_;  // guarded by refresh_mutex_

  std::mutex defaults_mutex_;
  // Both guarded by defaults_mutex_.
  int64_t defaults_steps_ = 0;
  std::optional<frames::FrameSpec> defaults_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SERVED_DATASET_H_
