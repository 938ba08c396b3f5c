#ifndef SERVICE_FRAMES_VOLUME_CACHE_H_
#define SERVICE_FRAMES_VOLUME_CACHE_H_

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>

#include "engine/base/status.h"
#include "engine/fovea/reconstruct.h"
#include "engine/store/dataset.h"
#include "service/frames/spec.h"

namespace fovea::frames {

/// One field of one step, reconstructed, and what that cost.
struct ReadVolume {
  SuperVoxels volume;
  store::ReadStats read;
  ReconstructStats times;
};

/// The memory that a volume takes.
[[nodiscard]] int64_t BytesOf(const SuperVoxels& volume);

/// Volumes that frames of the same step, field and fovea share, whatever their view: those used
/// last are kept, within a number of bytes. Several frames that want one at the same time make it
/// once. What was read with damage is given to those who wait for it, and not kept. Thread-safe.
class VolumeCache {
 public:
  using Volume = std::shared_ptr<const ReadVolume>;
  struct Counts {
    uint64_t hits = 0;    // kept, or made by another at the same time
    uint64_t misses = 0;  // made
    uint64_t evictions = 0;
    int64_t entries = 0, bytes = 0;
  };

  explicit VolumeCache(int64_t limit_bytes) : limit_bytes_(limit_bytes) {}

  struct Found {
    Volume volume;
    bool hit = false;
  };
  /// What is kept under `key`, or what `make` returns. Waits while another makes it, and then has
  /// that one's error, too.
  [[nodiscard]] StatusOr<Found> Get(const std::string& key,
                                    const std::function<StatusOr<ReadVolume>()>& make);

  [[nodiscard]] Counts counts();
  [[nodiscard]] int64_t limit_bytes() const { return limit_bytes_; }

 private:
  struct Kept {
    Volume volume;
    int64_t bytes = 0;
    std::list<std::string>::iterator age;
  };
  /// One that is being made.
  struct Making {
    bool done = false;
    Status status;
    Volume volume;
  };

  void Keep(const std::string& key, Volume volume);  // with mutex_ held

  const int64_t limit_bytes_;
  std::mutex mutex_;
  std::condition_variable made_;
  // All below: guarded by mutex_.
  std::unordered_map<std::string, Kept> kept_;
  std::list<std::string> ages_;  // keys of kept_, the one used last first
  std::unordered_map<std::string, std::shared_ptr<Making>> making_;
  Counts counts_;
};

/// A cache and the dataset's name in it: a number that no other dataset of the process has, nor
/// another store that takes its place.
struct SharedVolumes {
  VolumeCache* cache = nullptr;  // null: none is shared
  uint64_t dataset = 0;
};

/// The key of one field of a frame. `resolved` must come from ResolveSpec.
[[nodiscard]] std::string VolumeKey(uint64_t dataset, int64_t step, const std::string& field,
                                    const FrameSpec& resolved);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_VOLUME_CACHE_H_
