#ifndef ENGINE_RENDER_IMAGE_H_
#define ENGINE_RENDER_IMAGE_H_

#include <cstdint>
#include <vector>

#include "engine/render/transfer_function.h"

namespace fovea::render {

/// A premultiplied colour with its cover, as in a picture.
struct Rgba {
  float red = 0, green = 0, blue = 0, alpha = 0;
};

/// A picture in linear light, premultiplied: R, G, B, A floats, row 0 on top. Alpha is what the
/// volume covers; there is no background in it.
struct Image {
  int width = 0, height = 0;
  std::vector<float> rgba;  // 4 * width * height
};

/// sRGB bytes R, G, B, A over the background colour; alpha is the volume's cover. 8 bits by
/// floor(255 x + 1/2) after clamping.
[[nodiscard]] std::vector<uint8_t> ToSrgb8(const Image& image, const Color& background);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_IMAGE_H_
