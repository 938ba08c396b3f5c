// What may be skipped: bounds of blocks, transparent intervals, live blocks, spent pixels.
#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "engine/fovea/value_blocks.h"
#include "engine/render/live_blocks.h"
#include "engine/render/slice_view.h"
#include "engine/render/spent_pixels.h"

namespace fovea::render {
namespace {

Grid RandomGrid(const Box3& box, uint32_t seed) {
  Grid grid(box);
  std::mt19937 random(seed);
  for (float& value : grid.values) {
    value = std::uniform_real_distribution<float>(0, 1)(random);
  }
  return grid;
}

TEST(ValueBlocksTest, BoundWhateverASampleReads) {
  Grid grid = RandomGrid({{-3, -3, -3}, {20, 14, 6}}, 1);
  grid.At(4, 4, 4) = std::nanf("");
  const ValueBlocks blocks = MakeValueBlocks(grid, 1);
  EXPECT_EQ(blocks.count, (Int3{3, 3, 2}));
  for (int64_t z = -3; z < 5; ++z) {
    for (int64_t y = -3; y < 13; ++y) {
      for (int64_t x = -3; x < 19; ++x) {
        const size_t block = blocks.Index((x + 3) / 8, (y + 3) / 8, (z + 3) / 8);
        for (int corner = 0; corner < 8; ++corner) {
          const float value = grid.At(x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2));
          if (!std::isnan(value)) {
            ASSERT_LE(blocks.low[block], value);
            ASSERT_GE(blocks.high[block], value);
          }
        }
      }
    }
  }
  // And they are values of the block: tight.
  for (size_t i = 0; i < blocks.low.size(); ++i) {
    EXPECT_TRUE(std::find(grid.values.begin(), grid.values.end(), blocks.low[i]) !=
                grid.values.end());
    EXPECT_TRUE(std::find(grid.values.begin(), grid.values.end(), blocks.high[i]) !=
                grid.values.end());
  }
}

/// The largest value of a block is at its far corner, which the next block holds too.
TEST(ValueBlocksTest, ReachThePointsAfterThem) {
  Grid grid({{0, 0, 0}, {17, 17, 17}});
  for (int64_t z = 0; z < 17; ++z) {
    for (int64_t y = 0; y < 17; ++y) {
      for (int64_t x = 0; x < 17; ++x) {
        grid.At(x, y, z) = static_cast<float>(x + 100 * y + 10000 * z);
      }
    }
  }
  const ValueBlocks blocks = MakeValueBlocks(grid, 2);
  EXPECT_EQ(blocks.high[blocks.Index(0, 0, 0)], 80808);
  EXPECT_EQ(blocks.high[blocks.Index(1, 0, 1)], 160816);
  EXPECT_EQ(blocks.low[blocks.Index(1, 0, 1)], 80008);
  EXPECT_EQ(blocks.high[blocks.Index(2, 2, 2)], 161616);
}

TEST(ValueBlocksTest, NothingButNanHasNoBounds) {
  const ValueBlocks blocks = MakeValueBlocks(Grid({{0, 0, 0}, {4, 4, 4}}, std::nanf("")), 1);
  EXPECT_GT(blocks.low[0], blocks.high[0]);
}

TransferFunction WithOpacities(std::initializer_list<std::pair<double, float>> points) {
  TransferFunction transfer;
  for (const auto& [value, opacity] : points) {
    transfer.points.push_back({value, {1, 1, 1}, opacity});
  }
  return transfer;
}

TEST(TransparentValuesTest, AreTheIntervalsOfZeroOpacity) {
  const TransparentValues middle(
      WithOpacities({{0, 0.1F}, {1, 0.0F}, {2, 0.0F}, {3, 0.5F}, {4, 0.0F}}));
  EXPECT_TRUE(middle.Cover(1, 2));
  EXPECT_TRUE(middle.Cover(4, 99));
  EXPECT_TRUE(middle.Cover(4, 4));
  EXPECT_FALSE(middle.Cover(0.9F, 1.5F));
  EXPECT_FALSE(middle.Cover(1.5F, 2.1F));
  EXPECT_FALSE(middle.Cover(1.5F, 5));  // both ends are transparent, not what lies between
  EXPECT_FALSE(middle.Cover(-5, -4));
  const TransparentValues below(WithOpacities({{1, 0.0F}, {2, 0.3F}}));
  EXPECT_TRUE(below.Cover(-99, 1));
  EXPECT_FALSE(below.Cover(0, 1.01F));
  EXPECT_FALSE(below.Cover(3, 4));
  EXPECT_TRUE(TransparentValues(WithOpacities({{1, 0.0F}})).Cover(-9, 9));
  EXPECT_FALSE(TransparentValues(WithOpacities({{1, 0.2F}})).Cover(-9, 9));
  const TransparentValues step(WithOpacities({{0, 0.0F}, {1, 0.0F}, {1, 0.5F}, {2, 0.5F}}));
  EXPECT_TRUE(step.Cover(0, 1));
  EXPECT_FALSE(step.Cover(0, 1.1F));
}

/// Along each axis: a sample is live if one of its taps may show something, and what it reads was
/// turned.
TEST(LiveBlocksTest, FollowTheViewsAxes) {
  Grid grid({{-3, -2, -1}, {30, 21, 26}});
  grid.At(13, 9, 11) = 1;  // the only value that shows
  const ValueBlocks blocks = MakeValueBlocks(grid, 1);
  const TransparentValues transparent(WithOpacities({{0, 0.0F}, {1, 0.5F}}));
  for (const auto& [k, u, v] : {std::array{0, 1, 2}, std::array{1, 0, 2}, std::array{2, 0, 1}}) {
    ShearView view;
    view.axis_k = k;
    view.axis_u = u;
    view.axis_v = v;
    const LiveBlocks live(blocks, grid.box, transparent, view);
    std::vector<float> turned(grid.values.size(), -1.0F);
    const SliceView slices(grid, view, 1, &turned, &live);
    int64_t shown = 0;
    for (int64_t at_k = grid.box.lo[k]; at_k < grid.box.hi[k]; ++at_k) {
      for (int64_t at_v = grid.box.lo[v]; at_v + 1 < grid.box.hi[v]; ++at_v) {
        for (int64_t at_u = grid.box.lo[u]; at_u + 1 < grid.box.hi[u]; ++at_u) {
          Int3 p;
          p[k] = at_k;
          p[u] = at_u;
          p[v] = at_v;
          Int3 q = p;
          float most = 0;
          const bool is_live = live.Row(at_v, at_k)[live.BlockOf(at_u)] != 0;
          for (int corner = 0; corner < 4; ++corner) {
            q[u] = p[u] + (corner & 1);
            q[v] = p[v] + (corner >> 1);
            const float value = grid.At(q.x, q.y, q.z);
            most = std::max(most, value);
            if (is_live) {
              ASSERT_EQ(slices.Row(q[v], at_k)[q[u]], value) << "axis " << k;
            }
          }
          if (most > 0) {
            ASSERT_TRUE(is_live) << "axis " << k;
            ++shown;
          }
        }
      }
    }
    EXPECT_EQ(shown, 4);
    EXPECT_EQ(live.FirstOf(live.BlockOf(grid.box.lo[u] + 9)), grid.box.lo[u] + 8);
  }
}

Layer MakeLayer(const Rect& rect, float transmittance) {
  Layer layer;
  layer.plan.rect = rect;
  const auto pixels = static_cast<size_t>(rect.Width() * rect.Height());
  layer.front.Clear(pixels);
  layer.back.Clear(pixels);
  std::fill(layer.front.transmittance.begin(), layer.front.transmittance.end(), transmittance);
  layer.split.assign(pixels, 1);
  return layer;
}

TEST(SpentPixelsTest, APixelCountsWithThoseAroundItThatAreSplit) {
  Layer parent = MakeLayer({-4, 12, 0, 8}, 1e-6F);
  const Layer child = MakeLayer({-8, 24, 0, 16}, 1);
  std::vector<float> reach(parent.split.size(), 0.5F);
  std::vector<float> left;
  LeftBehindFront(parent, reach, &left);
  EXPECT_FLOAT_EQ(left[3], 0.5e-6F);
  const auto is_spent = [&](int64_t u, int64_t v, bool whole) {
    SpentPixels spent;
    FindSpentChildren(parent, left, child, 1e-4F, whole, &spent);
    return spent.runs[static_cast<size_t>(v * spent.runs_in_row + (u + 8) / SpentPixels::kRun)] !=
           0;
  };
  EXPECT_TRUE(is_spent(0, 4, false));
  // One pixel beside the run's parents (0 to 3) lets light through.
  left[parent.Index(4, 2)] = 0.4F;
  EXPECT_FALSE(is_spent(0, 4, false));
  EXPECT_TRUE(is_spent(-8, 4, false));
  // It does not matter if it is not split, unless it may yet be.
  parent.split[parent.Index(4, 2)] = 0;
  EXPECT_TRUE(is_spent(0, 4, false));
  EXPECT_FALSE(is_spent(0, 4, true));
  // Nor does it matter in which direction it lies.
  left[parent.Index(4, 2)] = 0;
  left[parent.Index(1, 3)] = 0.4F;
  EXPECT_FALSE(is_spent(0, 4, false));
  left[parent.Index(1, 3)] = 0;
  left[parent.Index(4, 2)] = 0.4F;
  std::vector<float> child_reach;
  PassDownReach(parent, left, child, &child_reach);
  EXPECT_FLOAT_EQ(child_reach[child.Index(9, 5)], 0.4F);
  EXPECT_FLOAT_EQ(child_reach[child.Index(10, 5)], 0.5e-6F);
}

}  // namespace
}  // namespace fovea::render
