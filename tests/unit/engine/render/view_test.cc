#include "engine/render/view.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "engine/render/image.h"
#include "engine/render/transfer_function.h"
#include "tests/support/status_matchers.h"

namespace fovea::render {
namespace {

using testing::FailsWith;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(ViewTest, LooksAlongXWithZUpAtZeroAngles) {
  const Int3 dims{40, 30, 20};
  const ShearView shear = FactorView({}, dims, Matrix4{}, 64, 64);
  EXPECT_EQ(shear.axis_k, 0);
  EXPECT_TRUE(shear.ascending);
  EXPECT_EQ(shear.slope_u, 0);
  EXPECT_EQ(shear.slope_v, 0);
  EXPECT_EQ(shear.step_length, 1);
  // right = d x up = -y: a point at larger y appears farther left; larger z, higher up.
  const OrthographicView view{0, 0, {}, 64};
  const auto middle = ProjectToPixel(view, dims, Matrix4{}, 64, 64, {3, 15, 10});
  EXPECT_DOUBLE_EQ(middle[0], 32);
  EXPECT_DOUBLE_EQ(middle[1], 32);
  const auto moved = ProjectToPixel(view, dims, Matrix4{}, 64, 64, {3, 18, 14});
  EXPECT_DOUBLE_EQ(moved[0], 29);
  EXPECT_DOUBLE_EQ(moved[1], 28);
}

TEST(ViewTest, TheWholeVolumeIsSeenByDefaultFromAnySide) {
  const Int3 dims{40, 90, 20};
  for (int trial = 0; trial < 60; ++trial) {
    const OrthographicView view{trial * 37.0, -90 + 3.0 * trial, {}, {}};
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 at{(corner & 1) * 40.0, (corner >> 1 & 1) * 90.0, (corner >> 2) * 20.0};
      const auto pixel = ProjectToPixel(view, dims, Matrix4{}, 100, 100, at);
      EXPECT_GE(pixel[0], -1e-9);
      EXPECT_LE(pixel[0], 100 + 1e-9);
      EXPECT_GE(pixel[1], -1e-9);
      EXPECT_LE(pixel[1], 100 + 1e-9);
    }
  }
}

/// The warp and the projection are two roads to the same place.
TEST(ViewTest, WarpAndProjectionAgreeWithObliqueMatrices) {
  Matrix4 matrix;
  matrix.m = {0.8, -0.45, 0.1, 3, 0.6, 0.6, 0.2, -7, 0.05, 0.1, 1.3, 11, 0, 0, 0, 1};
  const Int3 dims{40, 30, 50};
  for (int trial = 0; trial < 40; ++trial) {
    const OrthographicView view{trial * 31.0, -85 + 4.0 * trial, Vec3{20, 11, 30}, 45};
    const ShearView shear = FactorView(view, dims, matrix, 80, 60);
    EXPECT_LE(std::abs(shear.slope_u), 1 + 1e-12);
    EXPECT_LE(std::abs(shear.slope_v), 1 + 1e-12);
    const Vec3 point{7, 19, 33};
    const auto pixel = ProjectToPixel(view, dims, matrix, 80, 60, point);
    const double i = pixel[0] - 0.5;
    const double j = pixel[1] - 0.5;
    const auto& m = shear.warp;
    EXPECT_NEAR(m[0] * i + m[1] * j + m[2],
                point[shear.axis_u] - shear.slope_u * point[shear.axis_k], 1e-9);
    EXPECT_NEAR(m[3] * i + m[4] * j + m[5],
                point[shear.axis_v] - shear.slope_v * point[shear.axis_k], 1e-9);
  }
}

TEST(ViewTest, RefusesWhatIsOutOfRange) {
  EXPECT_THAT(Validate(OrthographicView{0, 91, {}, {}}), FailsWith(kInvalid, "elevation_deg 91"));
  EXPECT_THAT(Validate(OrthographicView{INFINITY, 0, {}, {}}), FailsWith(kInvalid, "azimuth_deg"));
  EXPECT_THAT(Validate(OrthographicView{0, 0, {}, 0.0}), FailsWith(kInvalid, "span_voxels"));
  EXPECT_THAT(Validate(OrthographicView{0, 0, Vec3{0, NAN, 0}, {}}), FailsWith(kInvalid, "its y"));
  EXPECT_OK(Validate(OrthographicView{-1000, -90, {}, 1e-3}));
}

TEST(TransferFunctionTest, ParsesAndFormatsBitForBit) {
  const std::string text = "-1.5:0.1,0.2,0.3:0;0.1:1,0.5,0.25:0.0333";
  ASSERT_OK_AND_ASSIGN(const TransferFunction transfer, ParseTransferFunction(text));
  ASSERT_EQ(transfer.points.size(), 2U);
  EXPECT_EQ(transfer.points[1].opacity, 0.0333F);
  ASSERT_OK_AND_ASSIGN(const TransferFunction again,
                       ParseTransferFunction(FormatTransferFunction(transfer)));
  EXPECT_EQ(again, transfer);
  ASSERT_OK_AND_ASSIGN(
      const TransferFunction json,
      ParseTransferFunction(R"([{"value": -1.5, "color": [0.1, 0.2, 0.3], "opacity": 0},
                                {"value": 0.1, "color": [1, 0.5, 0.25], "opacity": 0.0333}])"));
  EXPECT_EQ(json, transfer);
}

TEST(TransferFunctionTest, SaysWhatIsWrong) {
  EXPECT_THAT(ParseTransferFunction("0:1,1:0.5"),
              FailsWith(kInvalid, "'0:1,1:0.5' is not a point"));
  EXPECT_THAT(ParseTransferFunction(""), FailsWith(kInvalid, "0 points"));
  EXPECT_THAT(ParseTransferFunction("1:1,1,1:0;0:1,1,1:1"),
              FailsWith(kInvalid, "must not decrease"));
  EXPECT_THAT(ParseTransferFunction("1:1,1,1:1.5"), FailsWith(kInvalid, "opacity 1.5"));
  EXPECT_THAT(ParseTransferFunction("1:1,2,1:1"), FailsWith(kInvalid, "color 1,2,1"));
  EXPECT_THAT(ParseTransferFunction("nan:1,1,1:1"), FailsWith(kInvalid, "finite"));
  EXPECT_THAT(ParseTransferFunction("[{\"value\": 1}]"), FailsWith(kInvalid, "point 0"));
  EXPECT_THAT(ParseTransferFunction("[{]"), FailsWith(kInvalid, "not a list"));
}

TEST(TransferFunctionTest, ConstantOutsideItsPointsAndAStepAtOneValue) {
  const TransferTable table({{{2, {0, 0, 0}, 0.0F}, {2, {1, 1, 1}, 0.5F}}});
  const auto sigma_at = [&](float value) {
    const float x = std::clamp((value - table.offset()) * table.scale(), 0.0F,
                               static_cast<float>(TransferTable::kEntries - 1));
    const auto i = static_cast<int>(x);
    const auto& e = table.entries()[i];
    return e.sigma + (x - static_cast<float>(i)) * e.sigma_slope;
  };
  EXPECT_EQ(sigma_at(1.9F), 0);
  EXPECT_EQ(sigma_at(-1e30F), 0);
  EXPECT_NEAR(sigma_at(2.1F), std::log(2.0), 1e-6);
  EXPECT_NEAR(sigma_at(1e30F), std::log(2.0), 1e-6);
}

TEST(ImageTest, SrgbBytesRoundToNearestForEveryByte) {
  Image image{256, 1, std::vector<float>(1024)};
  for (int b = 0; b < 256; ++b) {
    const double srgb = b / 255.0;
    const double linear = srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
    image.rgba[4 * b] = static_cast<float>(linear);
    image.rgba[4 * b + 3] = 1;
  }
  const std::vector<uint8_t> bytes = ToSrgb8(image, {});
  for (int b = 0; b < 256; ++b) {
    EXPECT_EQ(bytes[4 * b], b);
    EXPECT_EQ(bytes[4 * b + 3], 255);
  }
}

/// The byte of a linear value, straight from the definition of sRGB.
int SrgbByteByFormula(float linear) {
  const double x = std::clamp(static_cast<double>(linear), 0.0, 1.0);
  const double srgb = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
  return static_cast<int>(std::floor(255 * srgb + 0.5));
}

TEST(ImageTest, SrgbBytesFollowTheFormulaAtEveryThresholdAndBetween) {
  std::vector<float> values;
  const auto one = std::bit_cast<uint32_t>(1.0F);
  for (uint32_t bits = 0; bits <= one; bits += 9973) {
    values.push_back(std::bit_cast<float>(bits));
  }
  for (int b = 1; b < 256; ++b) {
    uint32_t below = 0;  // the last float of a smaller byte, by bisection
    uint32_t from = one;
    while (from - below > 1) {
      const uint32_t middle = below + (from - below) / 2;
      (SrgbByteByFormula(std::bit_cast<float>(middle)) < b ? below : from) = middle;
    }
    for (int64_t bits = int64_t{below} - 2; bits <= int64_t{from} + 2; ++bits) {
      values.push_back(std::bit_cast<float>(static_cast<uint32_t>(bits)));
    }
  }
  Image image{static_cast<int>(values.size()), 1, {}};
  for (const float value : values) {
    image.rgba.insert(image.rgba.end(), {value, value, 1, 1});
  }
  const std::vector<uint8_t> bytes = ToSrgb8(image, {});
  for (size_t i = 0; i < values.size(); ++i) {
    ASSERT_EQ(bytes[4 * i], SrgbByteByFormula(values[i])) << "of " << values[i];
  }
}

TEST(ImageTest, TheBackgroundShowsWhereTheVolumeDoesNotCover) {
  const Image image{3, 1, {0, 0, 0, 0, 0.25F, 0, 0, 0.5F, NAN, 2, -1, 1}};
  const std::vector<uint8_t> bytes = ToSrgb8(image, {1, 1, 0});
  EXPECT_EQ(bytes[0], 255);  // white-yellow background
  EXPECT_EQ(bytes[2], 0);
  EXPECT_EQ(bytes[3], 0);    // alpha is the volume's
  EXPECT_EQ(bytes[4], 225);  // 0.25 + 0.5 * 1 = 0.75 linear
  EXPECT_EQ(bytes[7], 128);
  EXPECT_EQ(bytes[8], 0);  // not a number
  EXPECT_EQ(bytes[9], 255);
  EXPECT_EQ(bytes[10], 0);
}

}  // namespace
}  // namespace fovea::render
