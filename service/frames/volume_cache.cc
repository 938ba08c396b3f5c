#include "service/frames/volume_cache.h"

#include <utility>

namespace fovea::frames {

int64_t BytesOf(const SuperVoxels& volume) {
  size_t values = 0;
  for (const Grid& level : volume.levels) {
    values += level.values.capacity();
  }
  for (const ValueBlocks& blocks : volume.blocks) {
    values += blocks.low.capacity() + blocks.high.capacity();
  }
  constexpr size_t kOverhead = 4096;  // boxes, windows, the key
  return static_cast<int64_t>(values * sizeof(float) + kOverhead);
}

StatusOr<VolumeCache::Found> VolumeCache::Get(const std::string& key,
                                              const std::function<StatusOr<ReadVolume>()>& make) {
  std::shared_ptr<Making> making;
  {
    std::unique_lock lock(mutex_);
    if (const auto kept = kept_.find(key); kept != kept_.end()) {
      ++counts_.hits;
      ages_.splice(ages_.begin(), ages_, kept->second.age);
      return Found{kept->second.volume, true};
    }
    std::shared_ptr<Making>& slot = making_[key];
    if (slot != nullptr) {
      ++counts_.hits;
      making = slot;
      made_.wait(lock, [&] { return making->done; });
      FOVEA_RETURN_IF_ERROR(making->status);
      return Found{making->volume, true};
    }
    ++counts_.misses;
    making = slot = std::make_shared<Making>();
  }
  StatusOr<ReadVolume> result = make();
  const std::lock_guard lock(mutex_);
  making->done = true;
  making->status = result.status();
  if (result.ok()) {
    making->volume = std::make_shared<const ReadVolume>(*std::move(result));
    if (making->volume->read.chunks_damaged == 0) {
      Keep(key, making->volume);
    }
  }
  making_.erase(key);
  made_.notify_all();
  FOVEA_RETURN_IF_ERROR(making->status);
  return Found{making->volume, false};
}

void VolumeCache::Keep(const std::string& key, Volume volume) {
  const int64_t bytes = BytesOf(volume->volume);
  if (bytes > limit_bytes_) {
    return;
  }
  while (counts_.bytes > limit_bytes_ - bytes) {
    const auto oldest = kept_.find(ages_.back());
    counts_.bytes -= oldest->second.bytes;
    ++counts_.evictions;
    kept_.erase(oldest);
    ages_.pop_back();
  }
  ages_.push_front(key);
  kept_[key] = {std::move(volume), bytes, ages_.begin()};
  counts_.bytes += bytes;
}

VolumeCache::Counts VolumeCache::counts() {
  const std::lock_guard lock(mutex_);
  Counts counts = counts_;
  counts.entries = static_cast<int64_t>(kept_.size());
  return counts;
}

std::string VolumeKey(uint64_t dataset, int64_t step, const std::string& field,
                      const FrameSpec& resolved) {
  const Fovea fovea = FoveaOf(resolved);
  // The field last: it may hold any character.
  return fmt::format("{} {} {} {} {} {} {} {} {} {} {} {}", dataset, step, fovea.at.x, fovea.at.y,
                     fovea.at.z, fovea.rate.x, fovea.rate.y, fovea.rate.z,
                     static_cast<int>(fovea.window),
                     static_cast<int>(resolved.reconstruction.value_or(Reconstruction::kExact)),
                     resolved.strict, field);
}

}  // namespace fovea::frames
