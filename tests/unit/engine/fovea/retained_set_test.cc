#include "engine/fovea/retained_set.h"

#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea {
namespace {

using testing::FailsWith;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

Hierarchy MakeHierarchy(const Int3& dims) {
  return Hierarchy::Make(dims).value();
}

TEST(HierarchyTest, HalvesUntilEveryAxisIsAtMostSixteen) {
  const Hierarchy hierarchy = MakeHierarchy({256, 100, 17});
  EXPECT_EQ(hierarchy.finest(), 4);
  EXPECT_EQ(hierarchy.DimsAt(0), (Int3{16, 7, 2}));
  EXPECT_EQ(hierarchy.DimsAt(3), (Int3{128, 50, 9}));
  EXPECT_EQ(hierarchy.DimsAt(4), (Int3{256, 100, 17}));
  EXPECT_EQ(hierarchy.WidthAt(0), 16);
  EXPECT_EQ(MakeHierarchy({16, 3, 1}).finest(), 0);
}

TEST(HierarchyTest, RefusesSizesOutOfRange) {
  EXPECT_THAT(Hierarchy::Make({0, 4, 4}), FailsWith(kInvalid, "0 x 4 x 4"));
  EXPECT_THAT(Hierarchy::Make({4, 4, 65537}), FailsWith(kInvalid, "1 to 65536"));
}

TEST(RetainedSetTest, WindowsAreRoundR0WideAndClippedNotShifted) {
  const Hierarchy hierarchy = MakeHierarchy({512, 512, 512});
  ASSERT_OK_AND_ASSIGN(const RetainedSet set, RetainedSet::Make(hierarchy, {{256, 300, 2}, 24.6}));
  for (int level = 1; level < hierarchy.finest(); ++level) {  // level 0 is smaller than the window
    const Box3& window = set.window(level);
    if (level > 1) {
      EXPECT_EQ(window.Size().x, 25) << level;
      EXPECT_EQ(window.Size().y, 25) << level;
    }
    EXPECT_EQ(window.lo.z, 0);
    EXPECT_LE(window.hi.z, 14);  // half of it lies outside and is not made up for
  }
}

TEST(RetainedSetTest, WindowsNestForAnyFoveaAndRate) {
  std::mt19937 random(1);
  for (int trial = 0; trial < 4000; ++trial) {
    Int3 dims;
    Vec3 at;
    for (int axis = 0; axis < 3; ++axis) {
      dims[axis] = std::uniform_int_distribution<int64_t>(1, 300)(random);
      at[axis] = std::uniform_real_distribution<>(0, static_cast<double>(dims[axis]))(random);
      if (trial % 5 == 0) {  // on whole numbers, halves and borders, where rounding decides
        at[axis] = std::floor(2 * at[axis]) / 2;
      }
    }
    const double rate =
        trial % 3 == 0 ? 1 + trial % 12 : std::uniform_real_distribution<>(1, 60)(random);
    const Hierarchy hierarchy = MakeHierarchy(dims);
    ASSERT_OK_AND_ASSIGN(const RetainedSet set, RetainedSet::Make(hierarchy, {at, rate}));
    for (int level = 0; level < hierarchy.finest(); ++level) {
      EXPECT_TRUE(set.box(level).Contains(set.window(level)));
      // What Make would have had to cut off to make them nest: nothing.
      if (rate < static_cast<double>(dims.Max()) && !set.window(level).IsEmpty()) {
        const auto width = static_cast<int64_t>(std::floor(rate + 0.5));
        for (int axis = 0; axis < 3; ++axis) {
          const double centre = at[axis] / static_cast<double>(hierarchy.WidthAt(level));
          const auto lo =
              static_cast<int64_t>(std::floor(centre - static_cast<double>(width) / 2 + 0.5));
          const int64_t n = hierarchy.DimsAt(level)[axis];
          EXPECT_EQ(set.window(level).lo[axis], std::clamp<int64_t>(lo, 0, n));
          EXPECT_EQ(set.window(level).hi[axis], std::clamp<int64_t>(lo + width, 0, n));
        }
      }
    }
  }
}

TEST(RetainedSetTest, CountsCoefficientsAndSuperVoxels) {
  const Hierarchy hierarchy = MakeHierarchy({128, 128, 128});
  ASSERT_OK_AND_ASSIGN(const RetainedSet all, RetainedSet::Make(hierarchy, {{1, 2, 3}, 128}));
  EXPECT_EQ(all.CoefficientCount(), 128 * 128 * 128);
  EXPECT_EQ(all.SuperVoxelCount(), 128 * 128 * 128);
  ASSERT_OK_AND_ASSIGN(const RetainedSet some, RetainedSet::Make(hierarchy, {{64, 64, 64}, 12}));
  EXPECT_EQ(some.CoefficientCount(), 16 * 16 * 16 + 3 * 7 * 12 * 12 * 12);
  EXPECT_EQ(some.SuperVoxelCount(), some.CoefficientCount());  // even sizes: as many
}

TEST(RetainedSetTest, RefusesFoveasOutsideAndBadRates) {
  const Hierarchy hierarchy = MakeHierarchy({64, 64, 64});
  EXPECT_OK(RetainedSet::Make(hierarchy, {{64, 0, 64}, 1}));
  EXPECT_THAT(RetainedSet::Make(hierarchy, {{64.1, 0, 0}, 5}),
              FailsWith(kInvalid, "its x must be 0 to 64"));
  EXPECT_THAT(RetainedSet::Make(hierarchy, {{0, -0.1, 0}, 5}), FailsWith(kInvalid, "its y"));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(RetainedSet::Make(hierarchy, {{0, 0, nan}, 5}), FailsWith(kInvalid, "its z"));
  EXPECT_THAT(RetainedSet::Make(hierarchy, {{0, 0, 0}, 0}), FailsWith(kInvalid, "rate 0"));
  EXPECT_THAT(RetainedSet::Make(hierarchy, {{0, 0, 0}, nan}), FailsWith(kInvalid, "1 to 65536"));
}

}  // namespace
}  // namespace fovea
