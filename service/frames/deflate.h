#ifndef SERVICE_FRAMES_DEFLATE_H_
#define SERVICE_FRAMES_DEFLATE_H_

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "engine/base/status.h"

/// zlib streams (RFC 1950), as browsers read them.
namespace fovea::frames {

/// No stream makes more bytes of one of its own.
inline constexpr size_t kMostInflation = 1032;

/// Compressed with run-length matches alone: for planes of residuals as small as with longer ones,
/// and much faster. Appends to `to`.
[[nodiscard]] Status AppendDeflated(std::span<const uint8_t> bytes, std::string* to);

/// Reads a stream piece by piece. Hostile bytes are DATA_LOSS. `bytes` (below 2 GiB) must outlive
/// it. Not thread-safe.
class Inflater {
 public:
  [[nodiscard]] static StatusOr<Inflater> Make(std::string_view bytes);

  /// Fills all of `to`. DATA_LOSS if the stream ends before, or is not one.
  [[nodiscard]] Status Read(std::span<uint8_t> to);
  /// DATA_LOSS unless all was read, the stream's checksum holds and nothing follows it.
  [[nodiscard]] Status Finish();

 private:
  struct Stream;
  struct Closer {
    void operator()(Stream* stream) const;
  };
  explicit Inflater(std::unique_ptr<Stream, Closer> stream) : stream_(std::move(stream)) {}

  std::unique_ptr<Stream, Closer> stream_;
};

[[nodiscard]] uint32_t Crc32(std::string_view bytes);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_DEFLATE_H_
