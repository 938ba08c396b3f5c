#include "engine/volume/brick_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace fovea {
namespace {

/// By the definition, over every voxel.
FieldStats Direct(const BrickGrid& voxels) {
  std::vector<float> values(static_cast<size_t>(voxels.dims().Product()));
  voxels.CopyOut(Box3::OfSize(voxels.dims()), values);
  FieldStats stats;
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  stats.minimum = *least;
  stats.maximum = *most;
  const double scale = *most > *least ? 256 / (stats.maximum - stats.minimum) : 0;
  for (const float value : values) {
    ++stats.histogram[std::min<size_t>(static_cast<size_t>((value - stats.minimum) * scale), 255)];
  }
  return stats;
}

void ExpectAsByDefinition(const BrickGrid& voxels) {
  const FieldStats stats = ComputeStats(voxels);
  const FieldStats direct = Direct(voxels);
  EXPECT_EQ(stats.minimum, direct.minimum);
  EXPECT_EQ(stats.maximum, direct.maximum);
  EXPECT_EQ(stats.histogram, direct.histogram);
}

/// Some bricks of random values; dimensions need not be multiples of the edge.
BrickGrid RandomBricks(const Int3& dims, int64_t edge, float background, bool everywhere) {
  BrickGrid voxels(dims, edge, 1, background);
  std::mt19937 random(5);
  std::uniform_real_distribution<float> value(-3.0F, 40.0F);
  for (int64_t z = 0; z * edge < dims.z; ++z) {
    for (int64_t y = 0; y * edge < dims.y; ++y) {
      for (int64_t x = 0; x * edge < dims.x; ++x) {
        if (everywhere || random() % 2 == 0) {
          BrickGrid::Brick& brick = voxels.Touch({x, y, z});
          std::generate(brick.begin(), brick.end(), [&] { return value(random); });
        }
      }
    }
  }
  return voxels;
}

TEST(ComputeStats, CountsEveryVoxelOnceInsideTheGridAndNoneBeyond) {
  for (const Int3& dims : {Int3{40, 33, 21}, Int3{16, 16, 16}, Int3{5, 3, 2}, Int3{64, 8, 70}}) {
    for (const int64_t edge : {4, 8, 16}) {
      for (const bool everywhere : {false, true}) {
        const BrickGrid voxels = RandomBricks(dims, edge, 0.0F, everywhere);
        ExpectAsByDefinition(voxels);
        const FieldStats stats = ComputeStats(voxels);
        EXPECT_EQ(std::accumulate(stats.histogram.begin(), stats.histogram.end(), uint64_t{0}),
                  static_cast<uint64_t>(dims.Product()));
      }
    }
  }
}

TEST(ComputeStats, TheRangeIsFoundWhereverItsEndsLie) {
  BrickGrid voxels({24, 20, 17}, 8, 1, 1.0F);
  for (const Int3 at : {Int3{0, 0, 0}, Int3{7, 7, 7}, Int3{23, 19, 16}, Int3{9, 12, 3}}) {
    BrickGrid changed = voxels;
    changed.CopyIn({at, {at.x + 1, at.y + 1, at.z + 1}}, std::vector<float>{-5.0F});
    ExpectAsByDefinition(changed);
    changed.CopyIn({at, {at.x + 1, at.y + 1, at.z + 1}}, std::vector<float>{5.0F});
    ExpectAsByDefinition(changed);
  }
}

TEST(ComputeStats, BackgroundCountsWhereThereIsSomeOnly) {
  ExpectAsByDefinition(RandomBricks({40, 33, 21}, 8, 1000.0F, /*everywhere=*/false));
  EXPECT_LE(ComputeStats(RandomBricks({40, 33, 21}, 8, 1000.0F, /*everywhere=*/true)).maximum, 40);
}

TEST(ComputeStats, RunsOfOneValueAreCountedWhereTheyBelong) {
  BrickGrid voxels = RandomBricks({40, 33, 32}, 16, 0.0F, /*everywhere=*/true);
  voxels.CopyIn({{0, 0, 0}, {16, 16, 16}}, std::vector<float>(4096, 17.0F));
  voxels.CopyIn({{16, 3, 3}, {32, 5, 9}}, std::vector<float>(16 * 2 * 6, 39.0F));
  ExpectAsByDefinition(voxels);
}

TEST(ComputeStats, OneValueIsInTheFirstBin) {
  const FieldStats stats = ComputeStats(BrickGrid({9, 9, 9}, 8, 1, 7.0F));
  EXPECT_EQ(stats.minimum, 7);
  EXPECT_EQ(stats.maximum, 7);
  EXPECT_EQ(stats.histogram[0], 729U);
}

TEST(ComputeStats, ValuesThatAreNoNumbersDoNoHarm) {
  BrickGrid voxels({16, 16, 16}, 16, 1, 0.0F);
  BrickGrid::Brick& brick = voxels.Touch({0, 0, 0});
  brick[100] = std::numeric_limits<float>::quiet_NaN();
  brick[200] = 2.0F;
  const FieldStats stats = ComputeStats(voxels);
  EXPECT_EQ(stats.maximum, 2);
  EXPECT_EQ(stats.histogram[255], 1U);
}

}  // namespace
}  // namespace fovea
