#include "ingest/quantise.h"

#include <cmath>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/store/stored_type.h"
#include "engine/wavelet/transform.h"
#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;

constexpr Wavelet kAll[] = {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97};
constexpr Int3 kDims{75, 40, 37};  // two levels and odd sizes

enum class Kind { kSmooth, kNoise, kSpikes };

BrickGrid Voxels(Kind kind, float size) {
  BrickGrid voxels(kDims, 16, 1, 0.0F);
  std::vector<float> values(static_cast<size_t>(kDims.Product()));
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (size_t i = 0; i < values.size(); ++i) {
    const float at = static_cast<float>(i) * 0.013F;
    values[i] = size * (kind == Kind::kSmooth  ? std::sin(at)
                        : kind == Kind::kNoise ? uniform(random)
                                               : (random() % 97 == 0 ? 1.0F : 0.0F));
  }
  voxels.CopyIn(Box3::OfSize(kDims), values);
  return voxels;
}

CoefficientSet Forward(const BrickGrid& voxels, Wavelet wavelet) {
  return wavelet::Forward(voxels, *Hierarchy::Make(voxels.dims()), {wavelet, false}, 1);
}

TEST(Quantise, NoVoxelIsFartherOffThanTheTolerance) {
  for (const Wavelet wavelet : kAll) {
    for (const Kind kind : {Kind::kSmooth, Kind::kNoise, Kind::kSpikes}) {
      for (const double relative : {0.3, 0.01, 1e-3, 2e-4}) {
        const BrickGrid voxels = Voxels(kind, 1000);
        const FieldStats stats = ComputeStats(voxels);
        CoefficientSet set = Forward(voxels, wavelet);
        store::FieldInfo field{"f"};
        ASSERT_OK(ChooseScales(set, stats, {relative, true}, &field));
        EXPECT_DOUBLE_EQ(field.tolerance, relative * (stats.maximum - stats.minimum));
        ASSERT_OK(Quantise(field, &set, 2));
        ASSERT_OK_AND_ASSIGN(const double error, LargestError(voxels, set, 2));
        EXPECT_LE(error, field.tolerance) << WaveletName(wavelet) << " " << relative;
        if (kind == Kind::kNoise) {
          EXPECT_GE(error, 0.2 * field.tolerance) << WaveletName(wavelet) << " " << relative;
        }
      }
    }
  }
}

/// Coefficients just below half a step, signs as bad as can be for Haar at one corner of each cell:
/// the bound is reached, and not passed.
TEST(Quantise, TheBoundIsTight) {
  for (const Wavelet wavelet : kAll) {
    const BrickGrid any = Voxels(Kind::kNoise, 1);
    CoefficientSet set = Forward(any, wavelet);
    store::FieldInfo field{"f"};
    ASSERT_OK(ChooseScales(set, ComputeStats(any), {0.01, false}, &field));
    for (size_t level = 0; level < field.scales.size(); ++level) {
      std::vector<std::array<int64_t, 3>> keys;
      for (const auto& [key, brick] : set.detail[level].bricks()) {
        keys.push_back(key);
      }
      for (const auto& [z, y, x] : keys) {
        for (float& value : set.detail[level].Touch({x, y, z})) {
          value = 0.4999F * field.scales[level];
        }
      }
    }
    MemorySource exact(set);
    ASSERT_OK_AND_ASSIGN(const Grid grid, ExtractVoxels(exact, Box3::OfSize(kDims)));
    BrickGrid voxels(kDims, 16, 1, 0.0F);
    voxels.CopyIn(grid.box, grid.values);
    ASSERT_OK(Quantise(field, &set, 1));
    for (const BrickGrid& level : set.detail) {
      for (const auto& [key, brick] : level.bricks()) {
        ASSERT_EQ(store::LargestMagnitude(brick), 0);
      }
    }
    ASSERT_OK_AND_ASSIGN(const double error, LargestError(voxels, set, 1));
    EXPECT_LE(error, 0.01);
    EXPECT_GE(error, wavelet == Wavelet::kHaar ? 0.0099 : 0.002) << WaveletName(wavelet);
  }
}

TEST(Quantise, FindsAnErrorWhereverItIs) {
  const BrickGrid voxels = Voxels(Kind::kSmooth, 1);
  for (const Int3 at : {Int3{0, 0, 0}, Int3{74, 39, 36}, Int3{63, 20, 30}}) {
    const CoefficientSet set = Forward(voxels, Wavelet::kHaar);
    BrickGrid other = voxels;
    std::vector<float> one(1);
    const Box3 box{at, {at.x + 1, at.y + 1, at.z + 1}};
    other.CopyOut(box, one);
    one[0] += 0.25F;
    other.CopyIn(box, one);
    ASSERT_OK_AND_ASSIGN(const double error, LargestError(other, set, 2));
    EXPECT_NEAR(error, 0.25, 1e-5);
  }
}

TEST(Quantise, RefusesWhatCannotBe) {
  const BrickGrid voxels = Voxels(Kind::kNoise, 1000);
  const CoefficientSet set = Forward(voxels, Wavelet::kHaar);
  const FieldStats stats = ComputeStats(voxels);
  store::FieldInfo field{"heat"};
  EXPECT_THAT(ChooseScales(set, stats, {1e-4, false}, &field),
              FailsWith(absl::StatusCode::kInvalidArgument, "float32"));
  const BrickGrid empty(kDims, 16, 1, 5.0F);
  ASSERT_OK(ChooseScales(Forward(empty, Wavelet::kHaar), ComputeStats(empty), {0.1, true}, &field));
  EXPECT_EQ(field.type, "float32");  // no part of nothing
  EXPECT_THAT(field.scales, ::testing::IsEmpty());
  ASSERT_OK(
      ChooseScales(Forward(empty, Wavelet::kHaar), ComputeStats(empty), {0.1, false}, &field));
  EXPECT_EQ(field.type, "int32");  // nothing is known of the steps that follow

  ASSERT_OK(ChooseScales(set, stats, {0.01, true}, &field));
  CoefficientSet large = Forward(Voxels(Kind::kNoise, 1e9F), Wavelet::kHaar);
  EXPECT_THAT(Quantise(field, &large, 2), FailsWith(absl::StatusCode::kOutOfRange, "heat"));
}

/// What a message advises must work.
TEST(Quantise, TheLeastToleranceThatIsOfferedIsTaken) {
  const BrickGrid voxels = Voxels(Kind::kNoise, 1000);
  const CoefficientSet set = Forward(voxels, Wavelet::kHaar);
  store::FieldInfo field{"f"};
  double tolerance = 1e-7;
  for (int tries = 0; tries < 3; ++tries) {
    const Status status = ChooseScales(set, ComputeStats(voxels), {tolerance, false}, &field);
    if (status.ok()) {
      EXPECT_GT(tries, 0);
      return;
    }
    const std::string message(MessageOf(status));
    const size_t give = message.find("give ");
    ASSERT_NE(give, std::string::npos) << message;
    tolerance = std::stod(message.substr(give + 5)) * 1.01;  // three digits were printed
  }
  FAIL() << "a tolerance of " << tolerance << " was offered, and refused";
}

TEST(Quantise, ReadsTolerances) {
  ASSERT_OK_AND_ASSIGN(const Tolerance absolute, ParseTolerance("0.25"));
  EXPECT_EQ(absolute.value, 0.25);
  EXPECT_FALSE(absolute.relative);
  ASSERT_OK_AND_ASSIGN(const Tolerance relative, ParseTolerance("1e-3r"));
  EXPECT_EQ(relative.value, 1e-3);
  EXPECT_TRUE(relative.relative);
  ASSERT_OK_AND_ASSIGN(const Tolerance percent, ParseTolerance("0.1%"));
  EXPECT_DOUBLE_EQ(percent.value, 1e-3);
  EXPECT_TRUE(percent.relative);
  for (const char* bad : {"", "r", "0", "-1", "nan", "inf", "1e999", "2r", "100%", "1x", "1 %"}) {
    EXPECT_THAT(ParseTolerance(bad), FailsWith(absl::StatusCode::kInvalidArgument, "tolerance"))
        << bad;
  }
}

}  // namespace
}  // namespace fovea::ingest
