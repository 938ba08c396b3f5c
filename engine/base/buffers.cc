#include "engine/base/buffers.h"

#include <sys/mman.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <map>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

#include <malloc.h>

namespace fovea {
namespace {

constexpr size_t kHugePage = size_t{2} << 20;

struct Free {
  void operator()(std::byte* memory) const { std::free(memory); }
};
using Memory = std::unique_ptr<std::byte, Free>;

/// In huge pages, where the system has them for those who ask: one fault for each instead of 512.
Memory Allocate(size_t size) {
  const bool is_large = size >= kHugePage;
  Memory memory(static_cast<std::byte*>(std::aligned_alloc(is_large ? kHugePage : 64, size)));
  if (memory == nullptr) {
    throw std::bad_alloc();
  }
  if (is_large) {
    ::madvise(memory.get(), size, MADV_HUGEPAGE);
  }
  return memory;
}

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
    memory = Allocate(size);
  }
  return {memory.release(), [size](std::byte* done) { TheKept().GiveBack(size, Memory(done)); }};
}

void KeepFreedMemory() {
  constexpr int kMostFromHeap = 4 << 20;
  constexpr int kStep = 1 << 20;
  ::mallopt(M_TRIM_THRESHOLD, static_cast<int>(kMostKept));
  ::mallopt(M_MMAP_THRESHOLD, kMostFromHeap);
  ::mallopt(M_TOP_PAD, kStep);
  ::mallopt(M_ARENA_MAX, 1);  // the heaps of further ones grow page by page
}

}  // namespace fovea
