#ifndef SERVICE_SERVER_LIVE_INGEST_H_
#define SERVICE_SERVER_LIVE_INGEST_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "engine/base/status.h"
#include "engine/sensors/reading_binner.h"
#include "ingest/sensors/sensor_store.h"
#include "service/server/catalogue.h"
#include "service/wire/readings.h"

namespace fovea::server {

/// Batches of readings into one dataset, whose writer it is: opens or makes the store, sorts, fills
/// and commits. Every call may wait for the disk, and destroying it too. Not thread-safe.
class LiveIngest {
 public:
  /// Open steps of one stream hold at most so many readings, some 60 bytes each.
  static constexpr int64_t kMostPendingReadings = int64_t{1} << 22;

  /// INVALID_ARGUMENT, naming the field, for what a dataset that is to be made lacks;
  /// FAILED_PRECONDITION if another writes to it, or it is not what `spec` says.
  [[nodiscard]] static StatusOr<std::unique_ptr<LiveIngest>> Open(Catalogue& catalogue,
                                                                  const wire::ReadingsSpec& spec);
  /// Removes a dataset that it made and that has no step. Steps that are open are dropped.
  ~LiveIngest();
  LiveIngest(const LiveIngest&) = delete;
  LiveIngest& operator=(const LiveIngest&) = delete;

  [[nodiscard]] int fields() const { return static_cast<int>(store_->fields().size()); }
  [[nodiscard]] int64_t committed_steps() const { return store_->committed_steps(); }
  [[nodiscard]] const sensors::ReadingCounts& counts() const { return binner_->counts(); }

  /// Sorts a batch in, and writes the steps that it closes. After an error nothing but counts() may
  /// be called.
  [[nodiscard]] Status Add(const wire::ReadingBatch& batch);
  /// Commits the steps that were closed.
  [[nodiscard]] Status Publish();
  /// How many batches, from the first, are safe: no crash loses any of their readings. 0 after an
  /// error.
  [[nodiscard]] int64_t SafeBatches() const { return safe_batches_; }

 private:
  LiveIngest() = default;
  [[nodiscard]] Status OpenStore(Catalogue& catalogue, const wire::ReadingsSpec& spec);
  [[nodiscard]] Status Append(ServedDataset& dataset, const wire::ReadingsSpec& spec);
  [[nodiscard]] Status StartBinner(const wire::ReadingsSpec& spec);

  std::unique_ptr<ingest::SensorStore> store_;
  std::optional<sensors::ReadingBinner> binner_;
  sensors::FillRule fill_;
  std::string made_path_;  // of a store that this made; else empty
  int64_t safe_batches_ = 0;
  int64_t unpublished_ = 0;  // steps
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_LIVE_INGEST_H_
