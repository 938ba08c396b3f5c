#include "engine/wavelet/buffers.h"

#include <algorithm>
#include <bit>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include <hwy/aligned_allocator.h>

namespace fovea::wavelet::internal {
namespace {

using Memory = hwy::AlignedFreeUniquePtr<std::byte[]>;

/// What is kept, by size; sizes are powers of two.
class Kept {
 public:
  Memory Take(size_t size) {
    const std::lock_guard lock(mutex_);
    std::vector<Memory>& free = free_[size];
    if (free.empty()) {
      return nullptr;
    }
    Memory memory = std::move(free.back());
    free.pop_back();
    bytes_ -= size;
    return memory;
  }
  void GiveBack(size_t size, Memory memory) {
    const std::lock_guard lock(mutex_);
    if (bytes_ + size <= kMostKept) {
      free_[size].push_back(std::move(memory));
      bytes_ += size;
    }
  }

 private:
  std::mutex mutex_;
  std::map<size_t, std::vector<Memory>> free_;
  size_t bytes_ = 0;
};

/// Never destroyed: buffers may outlive any other object.
Kept& TheKept() {
  static Kept& kept = *new Kept;
  return kept;
}

}  // namespace

std::shared_ptr<std::byte> TakeBytes(size_t bytes) {
  const size_t size = std::bit_ceil(std::max<size_t>(bytes, 64));
  Memory memory = TheKept().Take(size);
  if (memory == nullptr) {
    memory = hwy::AllocateAligned<std::byte>(size);
  }
  return {memory.release(),
          [size](std::byte* done) { TheKept().GiveBack(size, Memory(done, hwy::AlignedFreer())); }};
}

}  // namespace fovea::wavelet::internal
