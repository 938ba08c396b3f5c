#include "engine/store/blosc.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#define ZSTD_STATIC_LINKING_ONLY  // ZSTD_c_literalCompressionMode
#include <zstd.h>

#include "engine/store/shuffle.h"

namespace fovea::store {
namespace {

constexpr uint8_t kVersion = 2;      // of the format
constexpr uint8_t kZstdVersion = 1;  // of zstd in it
constexpr uint8_t kShuffled = 0x01;
constexpr uint8_t kCopied = 0x02;
constexpr uint8_t kBitShuffled = 0x04;
constexpr uint8_t kOneStream = 0x10;
constexpr uint8_t kZstdFormat = 4 << 5;
constexpr uint8_t kFormatMask = 7 << 5;
constexpr size_t kHeaderBytes = kBloscHeaderBytes;
/// Where the only block begins: behind the header and its one offset.
constexpr size_t kBlockOffset = kHeaderBytes + sizeof(uint32_t);

/// Floats of which at least so many are 0 are compressed as they lie: a gap is then one match, not
/// one in each plane of bytes (docs/decisions/0015).
constexpr double kLeastGaps = 0.3;

/// Planes of fewer bytes share a stream: older Blosc libraries take them for such, whatever is
/// said.
constexpr size_t kLeastSplit = 256;

struct Header {
  uint8_t version = kVersion;
  uint8_t inner_version = kZstdVersion;
  uint8_t flags = 0;
  uint8_t type_bytes = 0;
  uint32_t bytes = 0;        // of the values
  uint32_t block_bytes = 0;  // the same: one block
  uint32_t chunk_bytes = 0;  // header included
};
static_assert(sizeof(Header) == kHeaderBytes);

template <typename T>
void Put(const T& value, std::vector<std::byte>* out, size_t at) {
  std::memcpy(out->data() + at, &value, sizeof(T));
}

}  // namespace

struct BloscEncoder::State {
  ZSTD_CCtx* bytes = ZSTD_createCCtx();  // for planes of bytes of floats
  ZSTD_CCtx* whole = ZSTD_createCCtx();  // for those of whole numbers
  ZSTD_CCtx* gaps = ZSTD_createCCtx();   // for floats that are mostly 0
  std::vector<std::byte> planes, chunk;
  size_t size = 0;  // of `chunk` so far

  State();
  ~State() {
    ZSTD_freeCCtx(bytes);
    ZSTD_freeCCtx(whole);
    ZSTD_freeCCtx(gaps);
  }
  /// Appends one stream, of the bytes as they are if they do not get smaller.
  void AppendPlane(ZSTD_CCtx* context, std::span<const std::byte> plane);
  /// Appends floats as they are as one stream; false, and nothing is appended, if that takes more
  /// than their planes would without the gaps.
  [[nodiscard]] bool AppendGaps(std::span<const std::byte> values);
};

// Parameters by measurement (docs/decisions/0015 and 0029). Only long matches are worth a sequence;
// a table that stays in the first cache finds those of floats, the smallest one those of whole
// numbers. Of these and of gaps few places are looked at (targetLength); the Huffman coder, which
// zstd leaves out then unless it is told, is worth its time.
BloscEncoder::State::State() {
  for (ZSTD_CCtx* context : {bytes, whole, gaps}) {
    ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, 1);
    ZSTD_CCtx_setParameter(context, ZSTD_c_minMatch, 7);
    ZSTD_CCtx_setParameter(context, ZSTD_c_hashLog, context == whole ? 6 : 10);
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
    if (context != bytes) {
      ZSTD_CCtx_setParameter(context, ZSTD_c_targetLength, 4);
      ZSTD_CCtx_setParameter(context, ZSTD_c_literalCompressionMode, ZSTD_ps_enable);
    }
  }
}

void BloscEncoder::State::AppendPlane(ZSTD_CCtx* context, std::span<const std::byte> plane) {
  const size_t start = size + sizeof(uint32_t);
  size_t stream = ZSTD_compress2(context, chunk.data() + start, chunk.size() - start, plane.data(),
                                 plane.size());
  if (ZSTD_isError(stream) != 0 || stream >= plane.size()) {
    std::memcpy(chunk.data() + start, plane.data(), plane.size());
    stream = plane.size();  // this says that it was copied
  }
  Put(static_cast<uint32_t>(stream), &chunk, size);
  size = start + stream;
}

bool BloscEncoder::State::AppendGaps(std::span<const std::byte> values) {
  const size_t start = size + sizeof(uint32_t);
  const auto most = static_cast<size_t>((1 - kLeastGaps) * static_cast<double>(values.size()));
  const size_t stream =
      ZSTD_compress2(gaps, chunk.data() + start, most, values.data(), values.size());
  if (ZSTD_isError(stream) != 0) {  // no room
    return false;
  }
  Put(static_cast<uint32_t>(stream), &chunk, size);
  size = start + stream;
  return true;
}

namespace {

/// Whether kLeastGaps of values of 4 bytes are 0 and the others fill their bytes, going by every
/// fourth run of them. Of floats that are small whole numbers a plane or two are all 0, which is
/// worth more than gaps.
bool HasGaps(std::span<const std::byte> values) {
  constexpr size_t kRun = 16;
  std::array<uint32_t, kRun> words;
  size_t runs = 0, zeros = 0, short_ones = 0;
  for (size_t at = 0; at + sizeof(words) <= values.size(); at += 4 * sizeof(words)) {
    std::memcpy(words.data(), values.data() + at, sizeof(words));
    uint32_t of_run = 0, short_of_run = 0;
    for (const uint32_t word : words) {
      of_run += word == 0 ? 1 : 0;
      short_of_run += (word & 0xFF) == 0 ? 1 : 0;
    }
    zeros += of_run;
    short_ones += short_of_run;
    ++runs;
  }
  const size_t others = runs * kRun - zeros;
  return static_cast<double>(zeros) > kLeastGaps * static_cast<double>(runs * kRun) &&
         2 * (short_ones - zeros) <= others;
}

}  // namespace

BloscEncoder::BloscEncoder() : state_(std::make_unique<State>()) {}

BloscEncoder::~BloscEncoder() = default;

StatusOr<std::span<const std::byte>> BloscEncoder::Encode(std::span<const std::byte> values,
                                                          int type_bytes, ValueKind kind) {
  State& s = *state_;
  const auto width = static_cast<size_t>(type_bytes);
  const size_t count = values.size() / width;
  if (values.empty() || values.size() > std::numeric_limits<int32_t>::max() / 2 ||
      count * width != values.size()) {
    return Internal("{} bytes of values of {} cannot be a chunk", values.size(), type_bytes);
  }
  s.planes.resize(values.size());
  s.chunk.resize(kBlockOffset + values.size() + width * sizeof(uint32_t) + 64);
  Header header;
  header.type_bytes = static_cast<uint8_t>(type_bytes);
  header.bytes = header.block_bytes = static_cast<uint32_t>(values.size());
  s.size = kBlockOffset;
  Put(static_cast<uint32_t>(kBlockOffset), &s.chunk, kHeaderBytes);
  if (kind == ValueKind::kFloat && type_bytes == sizeof(float) && HasGaps(values) &&
      s.AppendGaps(values)) {
    header.flags = kOneStream | kZstdFormat;
  } else {
    header.flags = kShuffled | kZstdFormat;
    ShuffleBytes(values.data(), count, type_bytes, s.planes.data());
    const size_t stream = count < kLeastSplit ? values.size() : count;
    header.flags = static_cast<uint8_t>(header.flags | (count < kLeastSplit ? kOneStream : 0));
    for (size_t at = 0; at < values.size(); at += stream) {
      s.AppendPlane(kind == ValueKind::kWhole ? s.whole : s.bytes,
                    std::span(s.planes).subspan(at, stream));
    }
  }
  if (s.size >= kHeaderBytes + values.size()) {
    header.flags = static_cast<uint8_t>(header.flags | kCopied);
    std::memcpy(s.chunk.data() + kHeaderBytes, values.data(), values.size());
    s.size = kHeaderBytes + values.size();
  }
  header.chunk_bytes = static_cast<uint32_t>(s.size);
  Put(header, &s.chunk, 0);
  return std::span<const std::byte>(s.chunk.data(), s.size);
}

struct BloscDecoder::State {
  ZSTD_DCtx* context = ZSTD_createDCtx();
  std::vector<std::byte> planes, scratch;
  ~State() { ZSTD_freeDCtx(context); }
  /// Fills `planes` with streams of equal size.
  [[nodiscard]] Status ReadStreams(std::span<const std::byte> block, size_t streams);
  [[nodiscard]] Status ReadStream(std::span<const std::byte> stream, std::span<std::byte> plane);
};

// Decoding is into a buffer of known size in one call: no frame, whatever it claims, makes zstd
// allocate a window or write past the end.
Status BloscDecoder::State::ReadStream(std::span<const std::byte> stream,
                                       std::span<std::byte> plane) {
  if (stream.size() == plane.size()) {
    std::memcpy(plane.data(), stream.data(), plane.size());
    return absl::OkStatus();
  }
  const size_t size =
      ZSTD_decompressDCtx(context, plane.data(), plane.size(), stream.data(), stream.size());
  if (ZSTD_isError(size) != 0) {
    return DataLoss("zstd cannot decompress it: {}", ZSTD_getErrorName(size));
  }
  if (size != plane.size()) {
    return DataLoss("{} bytes instead of {}", size, plane.size());
  }
  return absl::OkStatus();
}

Status BloscDecoder::State::ReadStreams(std::span<const std::byte> block, size_t streams) {
  const size_t plane = planes.size() / streams;
  for (size_t stream = 0; stream < streams; ++stream) {
    uint32_t bytes = 0;
    if (block.size() < sizeof(bytes)) {
      return DataLoss("its Blosc chunk ends too early");
    }
    std::memcpy(&bytes, block.data(), sizeof(bytes));
    block = block.subspan(sizeof(bytes));
    if (bytes > block.size()) {
      return DataLoss("its Blosc chunk ends too early");
    }
    FOVEA_RETURN_IF_ERROR(
        ReadStream(block.first(bytes), std::span(planes).subspan(stream * plane, plane)));
    block = block.subspan(bytes);
  }
  return absl::OkStatus();
}

BloscDecoder::BloscDecoder() : state_(std::make_unique<State>()) {}

BloscDecoder::~BloscDecoder() = default;

namespace {

/// The header of a chunk that says what it must.
StatusOr<Header> CheckHeader(std::span<const std::byte> chunk, int type_bytes, size_t bytes) {
  Header header;
  if (bytes == 0) {
    return DataLoss("there is no Blosc chunk of no values");
  }
  if (chunk.size() < kHeaderBytes) {
    return DataLoss("{} bytes are too few for a Blosc chunk", chunk.size());
  }
  std::memcpy(&header, chunk.data(), kHeaderBytes);
  const bool is_copied = (header.flags & kCopied) != 0;
  if (header.version != kVersion || header.type_bytes != type_bytes ||
      header.chunk_bytes != chunk.size() ||
      (!is_copied && (header.flags & kFormatMask) != kZstdFormat)) {
    return DataLoss("its Blosc header is not that of values of {} bytes in zstd", type_bytes);
  }
  if (header.bytes != bytes || (!is_copied && header.block_bytes != bytes)) {
    return DataLoss("its Blosc header does not say that it holds {} bytes in one block", bytes);
  }
  return header;
}

}  // namespace

Status BloscDecoder::Decode(std::span<const std::byte> chunk, int type_bytes,
                            std::span<std::byte> values) {
  State& s = *state_;
  FOVEA_ASSIGN_OR_RETURN(const Header header, CheckHeader(chunk, type_bytes, values.size()));
  if ((header.flags & kCopied) != 0) {
    if (chunk.size() != kHeaderBytes + values.size()) {
      return DataLoss("its Blosc chunk has {} bytes instead of {}", chunk.size(),
                      kHeaderBytes + values.size());
    }
    std::memcpy(values.data(), chunk.data() + kHeaderBytes, values.size());
    return absl::OkStatus();
  }
  const auto width = static_cast<size_t>(type_bytes);
  const size_t count = values.size() / width;
  uint32_t start = 0;
  if (chunk.size() >= kBlockOffset) {
    std::memcpy(&start, chunk.data() + kHeaderBytes, sizeof(start));
  }
  const bool is_bits = (header.flags & kBitShuffled) != 0;
  if (start != kBlockOffset || count * width != values.size() || (is_bits && count % 8 != 0)) {
    return DataLoss("its Blosc chunk is not one block of values of {} bytes", type_bytes);
  }
  s.planes.resize(values.size());
  s.scratch.resize(values.size());
  FOVEA_RETURN_IF_ERROR(
      s.ReadStreams(chunk.subspan(start), (header.flags & kOneStream) != 0 ? 1 : width));
  if (is_bits) {
    UnshuffleBits(s.planes.data(), count, type_bytes, s.scratch.data(), values.data());
  } else if ((header.flags & kShuffled) != 0) {
    UnshuffleBytes(s.planes.data(), count, type_bytes, values.data());
  } else {
    std::memcpy(values.data(), s.planes.data(), values.size());
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
