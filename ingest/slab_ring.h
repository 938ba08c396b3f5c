#ifndef INGEST_SLAB_RING_H_
#define INGEST_SLAB_RING_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "engine/base/status.h"

/// Memory that a program and its worker share, for dense voxels on their way: slabs that the worker
/// fills in turn and the program empties. It is made by the program, and can be neither shrunk nor
/// grown by anybody. What is in a slab can change while the program looks at it, if the worker is
/// hostile: copy first, then check.
namespace fovea::ingest {

inline constexpr uint32_t kSlabs = 4;
inline constexpr size_t kSlabBytes = size_t{4} << 20;
/// The descriptor under which a worker finds the memory.
inline constexpr int kSlabDescriptor = 3;

/// A mapping of the memory, all slabs.
class SlabRing {
 public:
  /// New memory, to be read here; the worker is started with descriptor() as kSlabDescriptor.
  [[nodiscard]] static StatusOr<std::unique_ptr<SlabRing>> Make();
  /// In the worker: the memory at kSlabDescriptor, to be written. Closes the descriptor.
  [[nodiscard]] static StatusOr<std::unique_ptr<SlabRing>> Adopt();
  ~SlabRing();
  SlabRing(const SlabRing&) = delete;
  SlabRing& operator=(const SlabRing&) = delete;

  /// Of Make; -1 after CloseDescriptor, and in the worker.
  [[nodiscard]] int descriptor() const { return descriptor_; }
  void CloseDescriptor();
  /// The slab at `index`, less than kSlabs.
  [[nodiscard]] std::span<std::byte> Slab(uint32_t index) {
    return {memory_ + index * kSlabBytes, kSlabBytes};
  }

 private:
  SlabRing(int descriptor, std::byte* memory) : descriptor_(descriptor), memory_(memory) {}

  int descriptor_;
  std::byte* memory_;
};

}  // namespace fovea::ingest

#endif  // INGEST_SLAB_RING_H_
