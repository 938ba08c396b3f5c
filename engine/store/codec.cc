#include "engine/store/codec.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <mutex>
#include <utility>

#include <isa-l/crc.h>
#include <zstd.h>

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
  const size_t zstd = ZSTD_compressBound(static_cast<size_t>(raw_bytes));
  return std::max(static_cast<int64_t>(zstd), raw_bytes + kBloscHeaderBytes) +
         static_cast<int64_t>(kCrcBytes);
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

namespace {

/// What decoders leave for the next ones: making a zstd context takes longer than a chunk. As many
/// as there were at a time, at most.
template <typename State>
class Pool {
 public:
  static std::unique_ptr<State> Take() {
    Pool& pool = Instance();
    const std::lock_guard lock(pool.mutex_);
    if (pool.idle_.empty()) {
      return std::make_unique<State>();
    }
    std::unique_ptr<State> state = std::move(pool.idle_.back());
    pool.idle_.pop_back();
    return state;
  }
  static void Return(std::unique_ptr<State> state) {
    Pool& pool = Instance();
    const std::lock_guard lock(pool.mutex_);
    pool.idle_.push_back(std::move(state));
  }

 private:
  static Pool& Instance() {
    static Pool& pool = *new Pool;  // for threads that outlive main
    return pool;
  }
  std::mutex mutex_;
  std::vector<std::unique_ptr<State>> idle_;  // guarded by mutex_
};

/// The bytes and their checksum.
std::vector<std::byte> WithCrc32c(std::span<const std::byte> content) {
  std::vector<std::byte> encoded;
  encoded.reserve(content.size() + kCrcBytes);
  encoded.assign(content.begin(), content.end());
  AppendCrc32c(encoded);
  return encoded;
}

}  // namespace

struct Encoder::State {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  BloscEncoder blosc;
  std::vector<std::byte> scratch, folded;

  State() {
    ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, kDefaultZstdLevel);
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
  }
  ~State() { ZSTD_freeCCtx(context); }
};

Encoder::Encoder() : state_(std::make_unique<State>()) {}

Encoder::~Encoder() = default;

StatusOr<std::vector<std::byte>> Encoder::Encode(std::span<const std::byte> raw) {
  std::vector<std::byte>& frame = state_->scratch;
  frame.resize(std::max(frame.size(), ZSTD_compressBound(raw.size())));
  const size_t size =
      ZSTD_compress2(state_->context, frame.data(), frame.size(), raw.data(), raw.size());
  if (ZSTD_isError(size) != 0) {
    return Internal("zstd cannot compress {} bytes: {}", raw.size(), ZSTD_getErrorName(size));
  }
  return WithCrc32c(std::span(frame).first(size));
}

StatusOr<std::vector<std::byte>> Encoder::EncodeValues(std::span<const float> values,
                                                       const Coding& coding) {
  const auto width = static_cast<int>(BytesOfType(coding.type));
  std::vector<std::byte>& raw = state_->scratch;
  raw.resize(std::max(raw.size(), values.size() * static_cast<size_t>(width)));
  const auto stored = std::span(raw).first(values.size() * static_cast<size_t>(width));
  FOVEA_RETURN_IF_ERROR(ToStored(values, coding, stored));
  return EncodeStored(stored, coding);
}

StatusOr<std::vector<std::byte>> Encoder::EncodeStored(std::span<const std::byte> stored,
                                                       const Coding& coding) {
  const auto width = static_cast<int>(BytesOfType(coding.type));
  if (coding.is_folded) {
    state_->folded.resize(stored.size());
    FoldSigns(stored, coding.type, state_->folded);
    stored = state_->folded;
  }
  FOVEA_ASSIGN_OR_RETURN(
      const std::span<const std::byte> chunk,
      state_->blosc.Encode(stored, width,
                           IsIntegerType(coding.type) ? ValueKind::kWhole : ValueKind::kFloat));
  return WithCrc32c(chunk);
}

struct Decoder::State {
  ZSTD_DCtx* context = ZSTD_createDCtx();
  BloscDecoder blosc;
  std::vector<std::byte> scratch;
  ~State() { ZSTD_freeDCtx(context); }
};

Decoder::Decoder() : state_(Pool<State>::Take()) {}

Decoder::~Decoder() {
  Pool<State>::Return(std::move(state_));
}

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

Status Decoder::DecodeValues(std::span<const std::byte> encoded, const Coding& coding,
                             std::span<float> values) {
  FOVEA_ASSIGN_OR_RETURN(const std::span<const std::byte> chunk, CheckCrc32c(encoded));
  const auto width = static_cast<int>(BytesOfType(coding.type));
  if (!IsIntegerType(coding.type)) {
    return state_->blosc.Decode(chunk, width, std::as_writable_bytes(values));
  }
  state_->scratch.resize(values.size() * static_cast<size_t>(width));
  FOVEA_RETURN_IF_ERROR(state_->blosc.Decode(chunk, width, state_->scratch));
  if (coding.is_folded) {
    UnfoldSigns(coding.type, state_->scratch);
  }
  FromStored(state_->scratch, coding, values);
  return absl::OkStatus();
}

}  // namespace fovea::store
