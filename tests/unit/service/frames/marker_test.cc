#include "service/frames/marker.h"

#include <gtest/gtest.h>

namespace fovea::frames {
namespace {

render::Image Green(int width, int height) {
  render::Image image{width, height, {}};
  for (int i = 0; i < width * height; ++i) {
    image.rgba.insert(image.rgba.end(), {0, 1, 0, 1});
  }
  return image;
}

const float* At(const render::Image& image, int column, int row) {
  return &image.rgba[4 * static_cast<size_t>(row * image.width + column)];
}

TEST(FoveaMarker, IsRedInTheMiddleWithADarkRim) {
  render::Image image = Green(100, 60);
  DrawFoveaMarker(&image, 40.5, 20.5);
  EXPECT_FLOAT_EQ(At(image, 40, 20)[0], 1);
  EXPECT_FLOAT_EQ(At(image, 40, 20)[1], 0);
  EXPECT_LT(At(image, 44, 20)[0], 0.6F);  // rim: neither red
  EXPECT_LT(At(image, 44, 20)[1], 0.9F);  // nor all green
  EXPECT_FLOAT_EQ(At(image, 50, 20)[1], 1);
}

TEST(FoveaMarker, GrowsWithThePicture) {
  render::Image image = Green(1200, 1000);
  DrawFoveaMarker(&image, 600, 500);
  EXPECT_GT(At(image, 606, 500)[0], 0.9F);  // radius 8
  EXPECT_FLOAT_EQ(At(image, 613, 500)[1], 1);
}

TEST(FoveaMarker, IsClippedAtAndBeyondTheEdges) {
  for (const double at : {-1e300, -1e4, -3.0, 0.0, 9.9, 12.0, 1e4, 1e300}) {
    render::Image image = Green(10, 10);
    DrawFoveaMarker(&image, at, 5);
    DrawFoveaMarker(&image, 5, at);
    EXPECT_EQ(image.rgba.size(), 400U);
  }
  render::Image image = Green(10, 10);
  DrawFoveaMarker(&image, 0, 0);
  EXPECT_FLOAT_EQ(At(image, 0, 0)[0], 1);
}

}  // namespace
}  // namespace fovea::frames
