#include "service/frames/encode.h"

#include <cstring>

#include "tests/support/decode.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::Decoded;
using ::fovea::testing::DecodeJpeg;
using ::fovea::testing::DecodePng;

/// A gradient, half transparent on the right, of odd size.
render::Image Gradient(int width, int height) {
  render::Image image{width, height, {}};
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      const float alpha = i < width / 2 ? 1.0F : 0.5F;
      const float u = static_cast<float>(i) / static_cast<float>(width);
      const float v = static_cast<float>(j) / static_cast<float>(height);
      image.rgba.insert(image.rgba.end(), {alpha * u, alpha * v, alpha * 0.25F, alpha});
    }
  }
  return image;
}

TEST(Encode, PngIsTheSrgbPictureWithoutLoss) {
  const render::Image image = Gradient(37, 21);
  const render::Color background{0.1F, 0.2F, 0.3F};
  ASSERT_OK_AND_ASSIGN(const std::string png, Encode(image, Encoding::kPng, background, 90));
  const Decoded decoded = DecodePng(png);
  ASSERT_EQ(decoded.width, 37);
  ASSERT_EQ(decoded.height, 21);
  const std::vector<uint8_t> expected = render::ToSrgb8(image, background);
  for (size_t pixel = 0; pixel < expected.size() / 4; ++pixel) {
    for (size_t c = 0; c < 3; ++c) {
      ASSERT_EQ(decoded.rgb[3 * pixel + c], expected[4 * pixel + c]) << pixel << " " << c;
    }
  }
  EXPECT_NE(png.find("sRGB"), std::string::npos);
}

TEST(Encode, JpegComesCloserWithQuality) {
  const render::Image image = Gradient(64, 48);
  const std::vector<uint8_t> expected = render::ToSrgb8(image, {});
  const auto error = [&](int quality) {
    const std::string jpeg = *Encode(image, Encoding::kJpeg, {}, quality);
    const Decoded decoded = DecodeJpeg(jpeg);
    EXPECT_EQ(decoded.width, 64);
    EXPECT_EQ(decoded.height, 48);
    double sum = 0;
    for (size_t pixel = 0; pixel < expected.size() / 4; ++pixel) {
      for (size_t c = 0; c < 3; ++c) {
        sum += std::abs(decoded.rgb[3 * pixel + c] - expected[4 * pixel + c]);
      }
    }
    return sum / static_cast<double>(decoded.rgb.size());
  };
  EXPECT_LT(error(95), 2.0);
  EXPECT_LT(error(95), error(10));
}

TEST(Encode, RawIsTopRowFirstWithoutPadding) {
  const render::Image image = Gradient(5, 3);
  ASSERT_OK_AND_ASSIGN(const std::string bytes, Encode(image, Encoding::kRawRgba8, {}, 90));
  const std::vector<uint8_t> expected = render::ToSrgb8(image, {});
  EXPECT_EQ(bytes, std::string(expected.begin(), expected.end()));
  EXPECT_EQ(static_cast<uint8_t>(bytes[4 * 4 + 3]), 128);  // the cover of the last pixel of row 0

  ASSERT_OK_AND_ASSIGN(const std::string floats, Encode(image, Encoding::kRawRgbaF32, {}, 90));
  ASSERT_EQ(floats.size(), 5U * 3 * 4 * 4);
  EXPECT_EQ(std::memcmp(floats.data(), image.rgba.data(), floats.size()), 0);
}

}  // namespace
}  // namespace fovea::frames
