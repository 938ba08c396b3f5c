#include "engine/fovea/reconstruct.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea {
namespace {

using testing::FailsWith;
using testing::MakeCoefficients;
using testing::MakeWavyGrid;

const std::vector<Int3>& Sizes() {
  static const std::vector<Int3> sizes = {{64, 64, 64}, {33, 47, 61}, {100, 17, 5},
                                          {16, 16, 16}, {1, 1, 40},   {7, 3, 2}};
  return sizes;
}

TEST(HaarTest, ForwardThenInverseGivesTheVoxelsBack) {
  for (const Int3& dims : Sizes()) {
    for (const int64_t edge : {8, 16, 32}) {
      const Grid volume = MakeWavyGrid(dims);
      const CoefficientSet set = MakeCoefficients(volume, edge);
      MemorySource source(set);
      ASSERT_OK_AND_ASSIGN(const Grid back, ExtractVoxels(source, volume.box));
      for (size_t i = 0; i < volume.values.size(); ++i) {
        // 4 ulp of the range, which is about 1.
        ASSERT_NEAR(volume.values[i], back.values[i], 4 * std::ldexp(1.0, -23)) << i;
      }
    }
  }
}

TEST(HaarTest, WholeNumbersComeBackExactly) {
  std::mt19937 random(2);
  Grid volume(Box3::OfSize({70, 33, 41}));
  for (float& value : volume.values) {
    value = static_cast<float>(std::uniform_int_distribution<>(0, 255)(random));
  }
  const CoefficientSet set = MakeCoefficients(volume);
  MemorySource source(set);
  ASSERT_OK_AND_ASSIGN(const Grid back, ExtractVoxels(source, volume.box));
  EXPECT_EQ(back.values, volume.values);
}

TEST(HaarTest, SuperVoxelsAreMeansInDataUnits) {
  const Grid volume = MakeWavyGrid({64, 64, 64});
  const CoefficientSet set = MakeCoefficients(volume);
  double mean = 0;
  for (int64_t z = 16; z < 20; ++z) {
    for (int64_t y = 8; y < 12; ++y) {
      for (int64_t x = 4; x < 8; ++x) {
        mean += volume.At(x, y, z) / 64;
      }
    }
  }
  EXPECT_NEAR(set.coarse.At(1, 2, 4), mean, 1e-6);
}

TEST(HaarTest, AStepInXIsInTheSubBandsHighInX) {
  const Grid volume = testing::MakeGrid({32, 32, 32}, [](double x, double, double) {
    return static_cast<int>(x) % 2 == 0 ? 1.0 : 0.0;
  });
  const CoefficientSet set = MakeCoefficients(volume);
  std::vector<float> detail(7);
  set.detail[0].CopyOut({{3, 4, 5}, {4, 5, 6}}, detail);
  EXPECT_EQ(detail, (std::vector<float>{0.5F, 0, 0, 0, 0, 0, 0}));
}

TEST(HaarTest, TheCostFollowsTheBricksThatAreThere) {
  BrickGrid voxels({4096, 4096, 4096}, 16, 1, 2.5F);
  voxels.Touch({100, 20, 200})[17] = 9;
  const Hierarchy hierarchy = Hierarchy::Make(voxels.dims()).value();
  const CoefficientSet set = wavelet::ForwardHaar(voxels, hierarchy, 1);
  for (const BrickGrid& level : set.detail) {
    EXPECT_EQ(level.bricks().size(), 1U);
  }
  MemorySource source(set);
  ASSERT_OK_AND_ASSIGN(const Grid back,
                       ExtractVoxels(source, {{1600, 320, 3200}, {1616, 336, 3216}}));
  EXPECT_FLOAT_EQ(back.values[17], 9);
  EXPECT_FLOAT_EQ(back.values[16], 2.5F);
}

TEST(BrickGridTest, StatsCountBackgroundAndStoredVoxelsOnce) {
  BrickGrid voxels({20, 10, 5}, 8, 1, -1);
  voxels.CopyIn({{17, 0, 0}, {25, 1, 1}}, std::vector<float>(8, 3.0F));  // five of them outside
  const FieldStats stats = ComputeStats(voxels);
  EXPECT_EQ(stats.minimum, -1);
  EXPECT_EQ(stats.maximum, 3);
  EXPECT_EQ(stats.histogram[0], 20U * 10 * 5 - 3);
  EXPECT_EQ(stats.histogram[255], 3U);
}

/// Every super-voxel the renderer may read, apron included, is the full inverse transform of the
/// kept coefficients at its place.
TEST(ReconstructTest, BoxesAndApronsEqualTheFoveatedVolume) {
  std::mt19937 random(4);
  for (const Int3& dims : Sizes()) {
    const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
    MemorySource source(set);
    for (const double rate : {1.0, 2.0, 5.0, 14.0}) {
      Fovea fovea{{}, rate};
      for (int axis = 0; axis < 3; ++axis) {
        fovea.at[axis] =
            std::uniform_real_distribution<>(0, static_cast<double>(dims[axis]))(random);
      }
      ASSERT_OK_AND_ASSIGN(const RetainedSet retained, RetainedSet::Make(set.hierarchy, fovea));
      ASSERT_OK_AND_ASSIGN(const SuperVoxels volume, Reconstruct(source, retained, 1));
      const int finest = set.hierarchy.finest();
      const Grid& leaves = volume.levels[finest];
      ASSERT_OK_AND_ASSIGN(const Grid foveated,
                           ExtractVoxels(source, Box3::OfSize(dims), &retained));
      const Box3 inside = Intersect(leaves.box, foveated.box);
      for (int64_t z = inside.lo.z; z < inside.hi.z; ++z) {
        for (int64_t y = inside.lo.y; y < inside.hi.y; ++y) {
          for (int64_t x = inside.lo.x; x < inside.hi.x; ++x) {
            // In the apron the finest level copies its parent, which detail may still refine
            // farther out only within the window: the foveated volume agrees.
            ASSERT_EQ(leaves.At(x, y, z), foveated.At(x, y, z)) << x << "," << y << "," << z;
          }
        }
      }
    }
  }
}

TEST(ReconstructTest, OutsideTheVolumeTheApronRepeatsTheBorder) {
  const Int3 dims{40, 40, 40};
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
  MemorySource source(set);
  ASSERT_OK_AND_ASSIGN(const RetainedSet retained,
                       RetainedSet::Make(set.hierarchy, {{0, 20, 40}, 10}));
  ASSERT_OK_AND_ASSIGN(const SuperVoxels volume, Reconstruct(source, retained, 1));
  const Grid& finest = volume.levels.back();
  EXPECT_EQ(finest.At(-3, 20, 38), finest.At(0, 20, 38));
  EXPECT_EQ(finest.At(2, 20, 42), finest.At(2, 20, 39));
  EXPECT_EQ(volume.levels[0].At(-2, 5, 12), volume.levels[0].At(0, 5, 9));
}

TEST(ReconstructTest, ExtractRefusesBoxesOutside) {
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid({20, 20, 20}));
  MemorySource source(set);
  EXPECT_THAT(ExtractVoxels(source, {{0, 0, 0}, {21, 1, 1}}),
              FailsWith(absl::StatusCode::kInvalidArgument, "20 x 20 x 20"));
  EXPECT_THAT(ExtractVoxels(source, {}), FailsWith(absl::StatusCode::kInvalidArgument, "box"));
}

}  // namespace
}  // namespace fovea
