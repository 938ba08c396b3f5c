#include "engine/store/codec.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <string_view>

#include <isa-l/crc.h>
#include <zstd.h>

#include "engine/store/stored_type.h"

namespace fovea::store {

static_assert(std::endian::native == std::endian::little,
              "values are copied to and from little-endian files as they are");

namespace {

constexpr size_t kCrcBytes = sizeof(uint32_t);

}  // namespace

uint32_t Crc32c(std::span<const std::byte> bytes) {
  uint32_t crc = ~uint32_t{0};
  while (!bytes.empty()) {
    const size_t piece = std::min<size_t>(bytes.size(), size_t{1} << 30);  // its length is an int
    // It takes a pointer to non-const, and does not write.
    auto* data = reinterpret_cast<unsigned char*>(const_cast<std::byte*>(bytes.data()));
    crc = crc32_iscsi(data, static_cast<int>(piece), crc);
    bytes = bytes.subspan(piece);
  }
  return ~crc;
}

int64_t MaxEncodedBytes(int64_t raw_bytes) {
  return static_cast<int64_t>(ZSTD_compressBound(static_cast<size_t>(raw_bytes)) + kCrcBytes);
}

StatusOr<std::span<const std::byte>> CheckCrc32c(std::span<const std::byte> bytes) {
  if (bytes.size() < kCrcBytes) {
    return DataLoss("{} bytes are too few to hold a checksum", bytes.size());
  }
  const std::span<const std::byte> content = bytes.first(bytes.size() - kCrcBytes);
  uint32_t stored = 0;
  std::memcpy(&stored, bytes.data() + content.size(), kCrcBytes);
  const uint32_t actual = Crc32c(content);
  if (stored != actual) {
    return DataLoss("checksum {:08x} instead of {:08x}", actual, stored);
  }
  return content;
}

void AppendCrc32c(std::vector<std::byte>& bytes) {
  const uint32_t crc = Crc32c(bytes);
  const auto* first = reinterpret_cast<const std::byte*>(&crc);
  bytes.insert(bytes.end(), first, first + kCrcBytes);
}

struct Encoder::State {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  ~State() { ZSTD_freeCCtx(context); }
};

Encoder::Encoder(int zstd_level) : state_(std::make_unique<State>()) {
  ZSTD_CCtx_setParameter(state_->context, ZSTD_c_compressionLevel, zstd_level);
  ZSTD_CCtx_setParameter(state_->context, ZSTD_c_checksumFlag, 1);
}

Encoder::~Encoder() = default;

StatusOr<std::vector<std::byte>> Encoder::Encode(std::span<const std::byte> raw) {
  std::vector<std::byte> encoded(ZSTD_compressBound(raw.size()));
  const size_t size =
      ZSTD_compress2(state_->context, encoded.data(), encoded.size(), raw.data(), raw.size());
  if (ZSTD_isError(size) != 0) {
    return Internal("zstd cannot compress {} bytes: {}", raw.size(), ZSTD_getErrorName(size));
  }
  encoded.resize(size);
  AppendCrc32c(encoded);
  return encoded;
}

struct Decoder::State {
  ZSTD_DCtx* context = ZSTD_createDCtx();
  ~State() { ZSTD_freeDCtx(context); }
};

Decoder::Decoder() : state_(std::make_unique<State>()) {}

Decoder::~Decoder() = default;

// Decoding is into a buffer of known size in one call: no frame, whatever it claims, makes zstd
// allocate a window or write past the end.
Status Decoder::Decode(std::span<const std::byte> encoded, std::span<std::byte> raw) {
  FOVEA_ASSIGN_OR_RETURN(const std::span<const std::byte> frame, CheckCrc32c(encoded));
  if (ZSTD_getFrameContentSize(frame.data(), frame.size()) != raw.size()) {
    return DataLoss("its zstd frame does not say that it holds {} bytes", raw.size());
  }
  const size_t size =
      ZSTD_decompressDCtx(state_->context, raw.data(), raw.size(), frame.data(), frame.size());
  if (ZSTD_isError(size) != 0) {
    return DataLoss("zstd cannot decompress it: {}", ZSTD_getErrorName(size));
  }
  if (size != raw.size()) {
    return DataLoss("{} bytes instead of {}", size, raw.size());
  }
  return absl::OkStatus();
}

Status Decoder::DecodeValues(std::span<const std::byte> encoded, const std::string& type,
                             std::span<float> values) {
  if (!IsIntegerType(type)) {
    return Decode(encoded, std::as_writable_bytes(values));
  }
  raw_.resize(values.size() * static_cast<size_t>(BytesOfType(type)));
  FOVEA_RETURN_IF_ERROR(Decode(encoded, raw_));
  FromStored(raw_, type, values);
  return absl::OkStatus();
}

}  // namespace fovea::store
