#ifndef SERVICE_FRAMES_FOVEATED_CODEC_H_
#define SERVICE_FRAMES_FOVEATED_CODEC_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/status.h"
#include "engine/render/leaf_scale.h"
#include "service/frames/foveated_picture.h"

/// The bytes of Encoding::kFoveated, docs/formats/foveated-frame.md. Thread-safe.
namespace fovea::frames {

/// First bytes of every version.
inline constexpr std::string_view kFoveatedMagic = "FVFR";

/// Leaf values are rounded to `bits` (SnapLeaves where it is kLeafBits). RESOURCE_EXHAUSTED for a
/// pyramid of more pixels than a frame may have.
[[nodiscard]] StatusOr<std::string> EncodeFoveated(const FoveatedPicture& picture,
                                                   int bits = render::kLeafBits);

/// An upper bound of the bytes of a frame whose pyramids have this many pixels.
[[nodiscard]] int64_t MostFoveatedBytes(int64_t pyramid_pixels);

/// What was encoded, its leaves rounded. Reads hostile bytes: DATA_LOSS, saying what, for whatever
/// is not a frame that EncodeFoveated could have made, without ever holding much more memory than
/// the bytes can fill.
[[nodiscard]] StatusOr<FoveatedPicture> DecodeFoveated(std::string_view bytes);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_FOVEATED_CODEC_H_
