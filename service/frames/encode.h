#ifndef SERVICE_FRAMES_ENCODE_H_
#define SERVICE_FRAMES_ENCODE_H_

#include <cstdint>
#include <span>
#include <string>

#include "engine/base/status.h"
#include "engine/render/image.h"
#include "service/frames/spec.h"

/// Pictures to bytes. Thread-safe.
namespace fovea::frames {

/// The bytes of `image` in `encoding`. PNG and JPEG are opaque, over `background`, and say sRGB;
/// RAW_RGBA8 is the same with the volume's cover as alpha; RAW_RGBA_F32 is the image as it is,
/// little-endian. `jpeg_quality` is 1 to 100. INVALID_ARGUMENT for FOVEATED, which is made from
/// what comes before the image (foveated_codec.h).
[[nodiscard]] StatusOr<std::string> Encode(const render::Image& image, Encoding encoding,
                                           const render::Color& background, int jpeg_quality);

/// PNG, JPEG, RAW_RGBA8, RAW_RGBA_F32 or FOVEATED: the name the proto gives it.
[[nodiscard]] const char* EncodingName(Encoding encoding);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_ENCODE_H_
