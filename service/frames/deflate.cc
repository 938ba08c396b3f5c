#include "service/frames/deflate.h"

#include <algorithm>
#include <limits>

#include <zlib.h>

namespace fovea::frames {
namespace {

constexpr size_t kMostAtOnce = size_t{1} << 30;  // zlib counts in 32 bits

Bytef* BytesOf(const char* p) {
  return reinterpret_cast<Bytef*>(const_cast<char*>(p));  // zlib reads them only
}

}  // namespace

Status AppendDeflated(std::span<const uint8_t> bytes, std::string* to) {
  constexpr int kLevel = 1;
  constexpr int kWindowBits = 15;
  constexpr int kMemoryLevel = 9;
  z_stream stream{};
  if (deflateInit2(&stream, kLevel, Z_DEFLATED, kWindowBits, kMemoryLevel, Z_RLE) != Z_OK) {
    return Internal("zlib cannot start: {}", stream.msg != nullptr ? stream.msg : "no memory");
  }
  const size_t begin = to->size();
  const size_t bound = deflateBound(&stream, bytes.size());
  if (std::max(bound, bytes.size()) > kMostAtOnce) {
    deflateEnd(&stream);
    return ResourceExhausted("a FOVEATED frame of {} bytes before compression is too large",
                             bytes.size());
  }
  to->resize(begin + bound);
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = BytesOf(to->data() + begin);
  stream.avail_out = static_cast<uInt>(bound);
  const int result = deflate(&stream, Z_FINISH);
  to->resize(begin + stream.total_out);
  deflateEnd(&stream);
  return result == Z_STREAM_END ? absl::OkStatus() : Internal("zlib cannot compress: {}", result);
}

struct Inflater::Stream {
  z_stream z{};
};

void Inflater::Closer::operator()(Stream* stream) const {
  inflateEnd(&stream->z);
  delete stream;
}

StatusOr<Inflater> Inflater::Make(std::string_view bytes) {
  if (bytes.size() > kMostAtOnce) {
    return DataLoss("a zlib stream of {} bytes is too large", bytes.size());
  }
  std::unique_ptr<Stream, Closer> stream(new Stream);
  if (inflateInit(&stream->z) != Z_OK) {
    return Internal("zlib cannot start");
  }
  stream->z.next_in = BytesOf(bytes.data());
  stream->z.avail_in = static_cast<uInt>(bytes.size());
  return Inflater(std::move(stream));
}

Status Inflater::Read(std::span<uint8_t> to) {
  if (to.empty()) {
    return absl::OkStatus();
  }
  if (to.size() > kMostAtOnce) {
    return DataLoss("{} bytes are due from a zlib stream, too many", to.size());
  }
  stream_->z.next_out = to.data();
  stream_->z.avail_out = static_cast<uInt>(to.size());
  const int result = inflate(&stream_->z, Z_SYNC_FLUSH);
  if (stream_->z.avail_out != 0 || (result != Z_OK && result != Z_STREAM_END)) {
    return DataLoss("its zlib stream is damaged or ends too early");
  }
  return absl::OkStatus();
}

Status Inflater::Finish() {
  uint8_t beyond = 0;
  stream_->z.next_out = &beyond;
  stream_->z.avail_out = 1;
  if (inflate(&stream_->z, Z_FINISH) != Z_STREAM_END || stream_->z.avail_out != 1 ||
      stream_->z.avail_in != 0) {
    return DataLoss("its zlib stream is damaged, or more follows than is due");
  }
  return absl::OkStatus();
}

uint32_t Crc32(std::string_view bytes) {
  return static_cast<uint32_t>(crc32_z(crc32(0, nullptr, 0), BytesOf(bytes.data()), bytes.size()));
}

}  // namespace fovea::frames
