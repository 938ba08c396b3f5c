#ifndef ENGINE_STORE_CODEC_H_
#define ENGINE_STORE_CODEC_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"

/// The codec chain of every chunk: little-endian values, one zstd frame with its own checksum,
/// then the CRC32C of that frame (4 bytes, little-endian).
namespace fovea::store {

inline constexpr int kDefaultZstdLevel = 1;

[[nodiscard]] uint32_t Crc32c(std::span<const std::byte> bytes);

/// The most bytes that `raw_bytes` can take up encoded.
[[nodiscard]] int64_t MaxEncodedBytes(int64_t raw_bytes);

/// Encodes chunks one after another. One thread at a time.
class Encoder {
 public:
  explicit Encoder(int zstd_level = kDefaultZstdLevel);
  ~Encoder();
  [[nodiscard]] StatusOr<std::vector<std::byte>> Encode(std::span<const std::byte> raw);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Decodes chunks one after another. One thread at a time.
class Decoder {
 public:
  Decoder();
  ~Decoder();
  /// Fills `raw`, whose size is what metadata says the chunk must have. DATA_LOSS, saying what is
  /// wrong but not where, if a checksum or a length does not fit.
  [[nodiscard]] Status Decode(std::span<const std::byte> encoded, std::span<std::byte> raw);
  /// The same for coefficients stored as `type` (stored_type.h).
  [[nodiscard]] Status DecodeValues(std::span<const std::byte> encoded, const std::string& type,
                                    std::span<float> values);

 private:
  struct State;
  std::unique_ptr<State> state_;
  std::vector<std::byte> raw_;
};

/// Splits the CRC32C off the end of `bytes` and checks it; DATA_LOSS if it does not fit.
[[nodiscard]] StatusOr<std::span<const std::byte>> CheckCrc32c(std::span<const std::byte> bytes);
/// Appends the CRC32C of what is there.
void AppendCrc32c(std::vector<std::byte>& bytes);

}  // namespace fovea::store

#endif  // ENGINE_STORE_CODEC_H_
