#ifndef ENGINE_STORE_CODEC_H_
#define ENGINE_STORE_CODEC_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/blosc.h"
#include "engine/store/stored_type.h"

/// The codec chains of chunks. Coefficients: little-endian values, whole numbers with their signs
/// folded (stored_type.h) if the coding says so, in a Blosc chunk (blosc.h), then the CRC32C of
/// that (4 bytes, little-endian). All else: the same with one zstd frame that carries its own
/// checksum instead of the Blosc chunk.
namespace fovea::store {

inline constexpr int kDefaultZstdLevel = 1;

[[nodiscard]] uint32_t Crc32c(std::span<const std::byte> bytes);

/// The most bytes that `raw_bytes` can take up encoded, either way.
[[nodiscard]] int64_t MaxEncodedBytes(int64_t raw_bytes);

/// Encodes chunks one after another. One thread at a time.
class Encoder {
 public:
  Encoder();
  ~Encoder();
  [[nodiscard]] StatusOr<std::vector<std::byte>> Encode(std::span<const std::byte> raw);
  /// Coefficients as ToStored (stored_type.h) makes them.
  [[nodiscard]] StatusOr<std::vector<std::byte>> EncodeStored(std::span<const std::byte> stored,
                                                              const Coding& coding);
  /// The same of floats, with the errors of ToStored.
  [[nodiscard]] StatusOr<std::vector<std::byte>> EncodeValues(std::span<const float> values,
                                                              const Coding& coding);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Decodes chunks one after another. One thread at a time. Cheap to make: what it needs is kept
/// from one to the next.
class Decoder {
 public:
  Decoder();
  ~Decoder();
  /// Fills `raw`, whose size is what metadata says the chunk must have. DATA_LOSS, saying what is
  /// wrong but not where, if a checksum or a length does not fit.
  [[nodiscard]] Status Decode(std::span<const std::byte> encoded, std::span<std::byte> raw);
  /// The same for coefficients.
  [[nodiscard]] Status DecodeValues(std::span<const std::byte> encoded, const Coding& coding,
                                    std::span<float> values);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Splits the CRC32C off the end of `bytes` and checks it; DATA_LOSS if it does not fit.
[[nodiscard]] StatusOr<std::span<const std::byte>> CheckCrc32c(std::span<const std::byte> bytes);
/// Appends the CRC32C of what is there.
void AppendCrc32c(std::vector<std::byte>& bytes);

}  // namespace fovea::store

#endif  // ENGINE_STORE_CODEC_H_
