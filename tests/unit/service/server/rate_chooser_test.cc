#include "service/server/rate_chooser.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace fovea::server {
namespace {

RateChooser::View ViewOf(const Rate& rate, int64_t side = 512) {
  return {*Hierarchy::Make({side, side, side}), {{256, 256, 256}, rate}, 512 * 512};
}

TEST(RateChooserTest, ABudgetThatIsLargeGivesWhatWasAskedFor) {
  const RateChooser chooser;
  const auto view = ViewOf(40);
  EXPECT_EQ(chooser.Within(1e6, view), 1);
  EXPECT_EQ(RateChooser::RateOf(1, view), Rate(40));
}

TEST(RateChooserTest, ASmallBudgetGivesTheLowestRungAndNeverARateBelowOne) {
  const RateChooser chooser;
  const auto view = ViewOf({40, 20, 3});
  const double part = chooser.Within(0, view);
  const Rate rate = RateChooser::RateOf(part, view);
  EXPECT_LE(rate.x, 8);
  EXPECT_GE(std::min({rate.x, rate.y, rate.z}), 1);
}

TEST(RateChooserTest, RungsRiseToTheEnd) {
  const RateChooser chooser;
  for (const Rate& rate : {Rate(40), Rate(4), Rate(1), Rate(500), Rate(65536), Rate(90, 20, 5)}) {
    const auto view = ViewOf(rate);
    double part = chooser.Within(0, view);
    int rungs = 0;
    while (part < 1) {
      const double next = chooser.Next(part, view);
      ASSERT_GT(next, part);
      part = next;
      ASSERT_LT(++rungs, 16);
    }
    EXPECT_EQ(part, 1);
  }
}

TEST(RateChooserTest, SlowFramesLowerTheRateAndFastOnesRaiseIt) {
  const auto view = ViewOf(200);
  RateChooser slow;
  RateChooser fast;
  const double before = slow.Within(40, view);
  for (int frame = 0; frame < 8; ++frame) {
    slow.Learn(before, view, 400);
    fast.Learn(before, view, 4);
  }
  EXPECT_LT(slow.Within(40, view), before);
  EXPECT_GT(fast.Within(40, view), before);
}

}  // namespace
}  // namespace fovea::server
