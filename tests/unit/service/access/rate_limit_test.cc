#include "service/access/rate_limit.h"

#include <gtest/gtest.h>

namespace fovea::access {
namespace {

using std::chrono::milliseconds;

TEST(RateLimitTest, NoLimitTakesAnything) {
  RateLimit limit(0);
  EXPECT_FALSE(limit.Take(1e18));
  EXPECT_FALSE(limit.Take(1e18));
}

TEST(RateLimitTest, ASecondsWorthAtOnceThenTheRate) {
  RateLimit::Clock::time_point now{};
  RateLimit limit(1000, now);
  EXPECT_FALSE(limit.Take(600, now));
  EXPECT_FALSE(limit.Take(600, now));  // 200 of debt
  EXPECT_EQ(limit.Take(1, now), milliseconds(201));
  EXPECT_EQ(limit.Take(1, now + milliseconds(100)), milliseconds(101));
  EXPECT_FALSE(limit.Take(3, now + milliseconds(202)));  // 2 were there
  EXPECT_EQ(limit.Take(1, now + milliseconds(202)), milliseconds(2));
}

TEST(RateLimitTest, OverALongTimeTheRateIsWhatIsGiven) {
  RateLimit::Clock::time_point now{};
  RateLimit limit(1000, now);
  double taken = 0;
  for (int ms = 0; ms < 100'000; ms += 7) {
    if (!limit.Take(333, now + milliseconds(ms))) {
      taken += 333;
    }
  }
  EXPECT_GT(taken, 100'000 - 400);
  EXPECT_LT(taken, 100'000 + 1000 + 400);
}

TEST(RateLimitTest, WhatIsLargerThanASecondsWorthIsPaidLater) {
  RateLimit::Clock::time_point now{};
  RateLimit limit(10, now);
  EXPECT_FALSE(limit.Take(1000, now));
  EXPECT_EQ(limit.Take(1, now), milliseconds(99'001));
}

TEST(RateLimitTest, WhatHasComeIsSpentWhateverIsLeft) {
  RateLimit::Clock::time_point now{};
  RateLimit limit(1000, now);
  EXPECT_EQ(limit.Spend(400, now), milliseconds(0));
  EXPECT_EQ(limit.Spend(700, now), milliseconds(101));
  EXPECT_EQ(limit.Spend(1000, now), milliseconds(1101));  // two streams share it
  now += milliseconds(1101);
  EXPECT_EQ(limit.Spend(0, now), milliseconds(0));
  EXPECT_EQ(RateLimit(0).Spend(1e12), milliseconds(0));
}

TEST(RateLimitTest, WhatIsGivenBackCanBeTakenAgain) {
  RateLimit::Clock::time_point now{};
  RateLimit limit(10, now);
  EXPECT_FALSE(limit.Take(30, now));
  EXPECT_TRUE(limit.Take(1, now));
  limit.GiveBack(30);
  EXPECT_FALSE(limit.Take(10, now));
  limit.GiveBack(1000);  // no more than a second's worth
  EXPECT_FALSE(limit.Take(10, now));
  EXPECT_TRUE(limit.Take(1, now));
}

TEST(RateLimitTest, RestIsNotSavedBeyondASecond) {
  RateLimit::Clock::time_point now{};
  RateLimit limit(10, now);
  now += std::chrono::hours(1);
  EXPECT_FALSE(limit.Take(10, now));
  EXPECT_TRUE(limit.Take(10, now));
}

}  // namespace
}  // namespace fovea::access
