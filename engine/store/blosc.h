#ifndef ENGINE_STORE_BLOSC_H_
#define ENGINE_STORE_BLOSC_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "engine/base/status.h"

/// Chunks of Blosc 1 (github.com/Blosc/c-blosc, README_CHUNK_FORMAT), as any Blosc reads them: a
/// header of 16 bytes, then one block of one or more zstd streams, or the bytes as they are. Each
/// zstd stream carries its own checksum.
namespace fovea::store {

/// Bytes of a chunk beyond those of its values, at most: what does not get smaller is kept as it
/// is.
inline constexpr int64_t kBloscHeaderBytes = 16;

/// What values are, which says how far to look for repeats; chunks do not tell it.
enum class ValueKind { kFloat, kWhole };

/// Makes chunks one after another. One thread at a time.
class BloscEncoder {
 public:
  BloscEncoder();
  ~BloscEncoder();
  /// The chunk of values of `type_bytes` (1, 2 or 4), at least one; valid until the next call.
  /// Bytes of like significance stand side by side, each plane of them a stream of its own.
  [[nodiscard]] StatusOr<std::span<const std::byte>> Encode(std::span<const std::byte> values,
                                                            int type_bytes, ValueKind kind);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Reads such chunks one after another. One thread at a time.
class BloscDecoder {
 public:
  BloscDecoder();
  ~BloscDecoder();
  /// Fills `values`, which hold values of `type_bytes`, at least one, whether bytes or bits were
  /// put side by side. DATA_LOSS, saying what is wrong, for anything but a chunk of so many bytes
  /// in one block. Takes no memory but for as many bytes.
  [[nodiscard]] Status Decode(std::span<const std::byte> chunk, int type_bytes,
                              std::span<std::byte> values);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_BLOSC_H_
