#ifndef ENGINE_BASE_BUFFERS_H_
#define ENGINE_BASE_BUFFERS_H_

#include <cstddef>
#include <memory>

/// Working memory that is used again: fresh pages would cost a tenth of a Haar transform, and as
/// much as filling them.
namespace fovea {

/// At least `bytes` bytes, aligned to 64, with any contents. When the last copy of the pointer
/// goes, they are kept for the next taker (kMostKept in all, by the process). Throws
/// std::bad_alloc. Thread-safe.
[[nodiscard]] std::shared_ptr<std::byte> TakeBytes(size_t bytes);
inline constexpr size_t kMostKept = size_t{64} << 20;

/// The same for `count` values.
template <typename Value>
[[nodiscard]] std::shared_ptr<Value> TakeBuffer(size_t count) {
  const std::shared_ptr<std::byte> bytes = TakeBytes(count * sizeof(Value));
  return {bytes, reinterpret_cast<Value*>(bytes.get())};
}

/// From now on the process keeps what it frees in all other ways too, up to kMostKept, instead of
/// giving it back to the system at once and asking for it again. To be called before there are
/// other threads.
void KeepFreedMemory();

}  // namespace fovea

#endif  // ENGINE_BASE_BUFFERS_H_
