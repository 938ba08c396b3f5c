#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/sensors/morton.h"
#include "engine/sensors/reading_binner.h"
#include "engine/sensors/step_buffer.h"
#include "tests/support/status_matchers.h"

namespace fovea::sensors {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::ElementsAre;

/// Windows of 10 s from 0 on over a box of 100 x 100 x 100 voxels of 1.
BinnerOptions TenSeconds() {
  BinnerOptions options;
  options.grid.hierarchy = *Hierarchy::Make({100, 100, 100});
  options.steps.window_s = 10;
  return options;
}

/// A binner, and what it handed out.
struct Stream {
  explicit Stream(const BinnerOptions& options)
      : binner(*ReadingBinner::Make(options, [this](const ClosedStep& step) {
          steps.push_back(step);
          return absl::OkStatus();
        })) {}
  Status Add(double time_s, float value, double x = 1.5, int64_t step = 0) {
    const Reading reading{x, 2.5, 3.5, time_s, step};
    return binner.Add({&reading, 1}, {&value, 1});
  }
  [[nodiscard]] std::vector<int64_t> Numbers() const {
    std::vector<int64_t> numbers;
    for (const ClosedStep& step : steps) {
      numbers.push_back(step.frame_number);
    }
    return numbers;
  }
  [[nodiscard]] float Value(size_t step) const { return steps.at(step).voxels.values[0].at(0); }

  std::vector<ClosedStep> steps;
  ReadingBinner binner;
};

/// Every reading is counted once.
void ExpectSum(const ReadingCounts& c) {
  EXPECT_EQ(c.read, c.used + c.duplicates + c.not_finite + c.out_of_range + c.outside + c.late +
                        c.ahead + c.pending);
}

TEST(BinnerTest, TimesOnABorderBelongToTheWindowThatBeginsThere) {
  // 0.3 / 0.1 is less than 3 in floating point, and so is much of the like in seconds since 1970.
  for (const double start : {0.0, 1.7e9}) {
    BinnerOptions options = TenSeconds();
    options.steps.window_s = 0.1;
    options.steps.start_s = start;
    Stream stream(options);
    for (int64_t i = 0; i < 100; ++i) {
      const auto time_ns = static_cast<int64_t>(start) * 1'000'000'000 + i * 100'000'000;
      ASSERT_OK(stream.Add(static_cast<double>(time_ns) / 1e9, 1));
    }
    ASSERT_EQ(stream.steps.size(), 99U) << start;
    EXPECT_EQ(stream.steps[3].frame_number, 3);
    EXPECT_EQ(stream.binner.counts().empty_windows, 0);
  }
}

TEST(BinnerTest, ATimeBeforeWhichAllHasComeClosesWindows) {
  BinnerOptions options = TenSeconds();
  options.steps.watermark_s = 100;
  Stream stream(options);
  ASSERT_OK(stream.Add(5, 1));
  ASSERT_OK(stream.Add(25, 2));
  ASSERT_OK(stream.binner.CloseBefore(9.5));
  EXPECT_TRUE(stream.steps.empty());
  ASSERT_OK(stream.binner.CloseBefore(20));
  EXPECT_THAT(stream.Numbers(), ElementsAre(0));
  ASSERT_OK(stream.Add(15, 3));  // late: its window is closed, though it held nothing
  EXPECT_EQ(stream.binner.counts().late, 1);
  ASSERT_OK(stream.binner.CloseBefore(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_EQ(stream.binner.counts().pending, 1);
}

TEST(BinnerTest, KnowsWhichCallsAreInClosedStepsAltogether) {
  BinnerOptions options = TenSeconds();
  options.steps.watermark_s = 10;
  Stream stream(options);
  EXPECT_EQ(stream.binner.SettledCalls(), 0);
  ASSERT_OK(stream.Add(5, 1));
  EXPECT_EQ(stream.binner.SettledCalls(), 0);
  ASSERT_OK(stream.Add(15, 1));       // both windows are open
  ASSERT_OK(stream.Add(6, 1));        // the first one again
  ASSERT_OK(stream.Add(16, 1, -50));  // outside the box: nothing to lose
  EXPECT_EQ(stream.binner.SettledCalls(), 0);
  ASSERT_OK(stream.Add(21, 1));  // closes the first
  EXPECT_THAT(stream.Numbers(), ElementsAre(0));
  EXPECT_EQ(stream.binner.SettledCalls(), 1);  // the second call is in the second window
  ASSERT_OK(stream.Add(31, 1));
  EXPECT_EQ(stream.binner.SettledCalls(), 4);
  ASSERT_OK(stream.binner.Finish());
  EXPECT_EQ(stream.binner.SettledCalls(), 6);
}

TEST(BinnerTest, WindowsCloseWhenAReadingPastTheirEndComes) {
  Stream stream(TenSeconds());
  ASSERT_OK(stream.Add(0, 1));
  ASSERT_OK(stream.Add(9.999, 2));
  EXPECT_TRUE(stream.steps.empty());
  ASSERT_OK(stream.Add(10, 5));
  EXPECT_THAT(stream.Numbers(), ElementsAre(0));
  EXPECT_EQ(stream.Value(0), 1.5F);
  EXPECT_EQ(stream.steps[0].time_ns, 0);
  EXPECT_EQ(stream.binner.counts().pending, 1);
  ASSERT_OK(stream.binner.Finish());
  EXPECT_THAT(stream.Numbers(), ElementsAre(0, 1));
  EXPECT_EQ(stream.steps[1].time_ns, 10'000'000'000);
  EXPECT_EQ(stream.binner.counts().used, 3);
  ExpectSum(stream.binner.counts());
}

TEST(BinnerTest, LateReadingsCountUntilTheWatermark) {
  BinnerOptions options = TenSeconds();
  options.steps.watermark_s = 5;
  Stream stream(options);
  ASSERT_OK(stream.Add(1, 1));
  ASSERT_OK(stream.Add(14.9, 2));
  ASSERT_OK(stream.Add(2, 3));  // out of order, in time
  EXPECT_TRUE(stream.steps.empty());
  ASSERT_OK(stream.Add(15, 4));  // the end + 5: closes window 0
  ASSERT_EQ(stream.steps.size(), 1U);
  EXPECT_EQ(stream.Value(0), 2);
  ASSERT_OK(stream.Add(9, 100));  // too late
  ASSERT_OK(stream.binner.Finish());
  EXPECT_EQ(stream.binner.counts().late, 1);
  EXPECT_EQ(stream.Value(1), 3);
  ExpectSum(stream.binner.counts());
}

TEST(BinnerTest, AWindowThatWasEmptyWhenItClosedStaysClosed) {
  Stream stream(TenSeconds());
  ASSERT_OK(stream.Add(1, 1));
  ASSERT_OK(stream.Add(35, 1));
  ASSERT_OK(stream.Add(15, 1));
  ASSERT_OK(stream.binner.Finish());
  EXPECT_THAT(stream.Numbers(), ElementsAre(0, 3));
  EXPECT_EQ(stream.binner.counts().late, 1);
  EXPECT_EQ(stream.binner.counts().empty_windows, 2);
}

TEST(BinnerTest, EmptyWindowsAreSkippedHeldOrAnError) {
  BinnerOptions options = TenSeconds();
  options.steps.on_empty = OnEmpty::kHold;
  Stream held(options);
  ASSERT_OK(held.Add(1, 7));
  ASSERT_OK(held.Add(31, 8));
  ASSERT_OK(held.binner.Finish());
  EXPECT_THAT(held.Numbers(), ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(held.Value(2), 7);
  EXPECT_TRUE(held.steps[1].held);
  EXPECT_FALSE(held.steps[3].held);
  EXPECT_EQ(held.steps[2].time_ns, 20'000'000'000);

  options.steps.on_empty = OnEmpty::kError;
  Stream strict(options);
  ASSERT_OK(strict.Add(1, 7));
  ASSERT_OK(strict.Add(31, 8));
  EXPECT_THAT(strict.binner.Finish(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "no readings from 10 s"));
}

TEST(BinnerTest, ABrokenClockDoesNotCloseEverything) {
  Stream stream(TenSeconds());
  ASSERT_OK(stream.Add(1, 1));
  ASSERT_OK(stream.Add(4e9, 1));
  ASSERT_OK(stream.Add(2, 3));
  ASSERT_OK(stream.binner.Finish());
  EXPECT_EQ(stream.binner.counts().ahead, 1);
  EXPECT_THAT(stream.Numbers(), ElementsAre(0));
  EXPECT_EQ(stream.Value(0), 2);
  ExpectSum(stream.binner.counts());
}

TEST(BinnerTest, NanInfinityRangeAndBox) {
  BinnerOptions options = TenSeconds();
  options.least_value = -10;
  options.greatest_value = 10;
  Stream stream(options);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  ASSERT_OK(stream.Add(1, NAN));
  ASSERT_OK(stream.Add(1, INFINITY));
  ASSERT_OK(stream.Add(1, 1, kNan));
  ASSERT_OK(stream.Add(kNan, 1));
  ASSERT_OK(stream.Add(1e300, 1));
  EXPECT_EQ(stream.binner.counts().not_finite, 5);
  ASSERT_OK(stream.Add(1, 10.5F));
  EXPECT_EQ(stream.binner.counts().out_of_range, 1);
  ASSERT_OK(stream.Add(1, 1, -0.001));
  ASSERT_OK(stream.Add(1, 1, 100.001));
  EXPECT_EQ(stream.binner.counts().outside, 2);
  ASSERT_OK(stream.Add(1, 2, 100));  // the upper face belongs to the last voxel
  ASSERT_OK(stream.Add(1, 3, 0));
  ASSERT_OK(stream.binner.Finish());
  ASSERT_EQ(stream.steps.size(), 1U);
  EXPECT_THAT(stream.steps[0].voxels.keys,
              ElementsAre(MortonKey({0, 2, 3}), MortonKey({99, 2, 3})));
  EXPECT_THAT(stream.steps[0].voxels.values[0], ElementsAre(3, 2));
  ExpectSum(stream.binner.counts());
}

TEST(BinnerTest, OfDuplicatesTheLastStandsOrEachCounts) {
  BinnerOptions options = TenSeconds();
  for (const int others : {0, 100}) {  // few and many readings in the voxel
    options.duplicates = Duplicates::kLast;
    Stream last(options);
    options.duplicates = Duplicates::kMean;
    Stream mean(options);
    for (Stream* stream : {&last, &mean}) {
      ASSERT_OK(stream->Add(1, 1));
      for (int i = 0; i < others; ++i) {
        ASSERT_OK(stream->Add(2, 4, 1.001 + 0.001 * i));
      }
      ASSERT_OK(stream->Add(1, 3));
      ASSERT_OK(stream->Add(1, 4));
      ASSERT_OK(stream->binner.Finish());
    }
    EXPECT_EQ(last.Value(0), 4);
    EXPECT_EQ(last.binner.counts().duplicates, 2);
    EXPECT_EQ(last.binner.counts().used, 1 + others);
    EXPECT_FLOAT_EQ(mean.Value(0), (8.0F + 4.0F * static_cast<float>(others)) /
                                       (3.0F + static_cast<float>(others)));
    EXPECT_EQ(mean.binner.counts().duplicates, 0);
    ExpectSum(last.binner.counts());
  }
}

TEST(BinnerTest, StepsByKeyInTheOrderOfTheirFirstReadings) {
  BinnerOptions options = TenSeconds();
  options.steps.window_s.reset();
  options.steps.watermark_s = 5;
  Stream stream(options);
  ASSERT_OK(stream.Add(100, 1, 1.5, /*step=*/7));
  ASSERT_OK(stream.Add(102, 2, 1.5, 3));
  ASSERT_OK(stream.Add(101, 3, 1.5, 7));  // step 7 is open until 101 + 5
  ASSERT_OK(stream.Add(106, 2, 1.5, 3));
  EXPECT_THAT(stream.Numbers(), ElementsAre(7));
  ASSERT_OK(stream.Add(101, 9, 1.5, 7));  // late
  ASSERT_OK(stream.binner.Finish());
  EXPECT_THAT(stream.Numbers(), ElementsAre(7, 3));
  EXPECT_EQ(stream.Value(0), 2);
  EXPECT_EQ(stream.steps[0].time_ns, 100'000'000'000);
  EXPECT_EQ(stream.steps[1].time_ns, 102'000'000'000);
  EXPECT_EQ(stream.binner.counts().late, 1);
  ExpectSum(stream.binner.counts());
}

TEST(BinnerTest, WhatIsBeforeTheFirstWindowIsLate) {
  BinnerOptions options = TenSeconds();
  options.steps.first_window = 2;
  options.steps.on_empty = OnEmpty::kError;
  Stream stream(options);
  ASSERT_OK(stream.Add(15, 1));
  ASSERT_OK(stream.Add(25, 1));
  ASSERT_OK(stream.binner.Finish());
  EXPECT_THAT(stream.Numbers(), ElementsAre(2));
  EXPECT_EQ(stream.binner.counts().late, 1);
}

TEST(BinnerTest, CallsMayBeCutAnyhow) {
  std::mt19937 random(3);
  BinnerOptions options = TenSeconds();
  options.channels = 2;
  options.steps.watermark_s = 12;
  std::vector<Reading> readings;
  std::vector<float> values;
  for (int i = 0; i < 5000; ++i) {
    const auto part = [&] { return static_cast<double>(random() % 1100) / 10; };
    readings.push_back({part(), part(), part(), i * 0.05 + static_cast<double>(random() % 30), 0});
    values.push_back(static_cast<float>(i));
    values.push_back(static_cast<float>(-i));
  }
  Stream whole(options);
  ASSERT_OK(whole.binner.Add(readings, values));
  Stream single(options);
  for (size_t i = 0; i < readings.size(); ++i) {
    ASSERT_OK(single.binner.Add({&readings[i], 1}, {&values[2 * i], 2}));
  }
  ASSERT_OK(whole.binner.Finish());
  ASSERT_OK(single.binner.Finish());
  ASSERT_EQ(whole.Numbers(), single.Numbers());
  ASSERT_GT(whole.steps.size(), 20U);
  EXPECT_GT(whole.binner.counts().late, 10);
  for (size_t i = 0; i < whole.steps.size(); ++i) {
    EXPECT_EQ(whole.steps[i].voxels.keys, single.steps[i].voxels.keys);
    EXPECT_EQ(whole.steps[i].voxels.values, single.steps[i].voxels.values);
    EXPECT_EQ(whole.steps[i].voxels.values[0][0], -whole.steps[i].voxels.values[1][0]);
  }
  ExpectSum(whole.binner.counts());
}

TEST(BinnerTest, TooManyPendingReadingsAreRefused) {
  BinnerOptions options = TenSeconds();
  options.most_pending = 2;
  Stream stream(options);
  ASSERT_OK(stream.Add(1, 1));
  ASSERT_OK(stream.Add(2, 1));
  EXPECT_THAT(stream.Add(3, 1), FailsWith(absl::StatusCode::kResourceExhausted, "watermark"));
}

TEST(BinnerTest, RulesThatCannotBeAreRefused) {
  const auto make = [](auto change) {
    BinnerOptions options = TenSeconds();
    change(&options);
    return ReadingBinner::Make(options, nullptr).status();
  };
  const auto bad = absl::StatusCode::kInvalidArgument;
  EXPECT_THAT(make([](auto* o) { o->steps.window_s = 0; }), FailsWith(bad, "window"));
  EXPECT_THAT(make([](auto* o) { o->steps.window_s = NAN; }), FailsWith(bad, "window"));
  EXPECT_THAT(make([](auto* o) { o->steps.watermark_s = -1; }), FailsWith(bad, "watermark"));
  EXPECT_THAT(make([](auto* o) { o->grid.voxel.y = 0; }), FailsWith(bad, "size"));
}

/// The radix sort against std::map, keys of all widths.
TEST(StepBufferTest, MeansByVoxel) {
  std::mt19937_64 random(9);
  StepBuffer buffer(1, Duplicates::kMean);
  std::map<uint64_t, std::pair<double, int>> sums;
  for (int i = 0; i < 20000; ++i) {
    const uint64_t key = (random() >> 16) >> (random() % 48);
    const auto value = static_cast<float>(random() % 1000);
    buffer.Add(key, static_cast<uint64_t>(i), &value);
    sums[key].first += value;
    ++sums[key].second;
  }
  const MeasuredVoxels voxels = buffer.Measure();
  ASSERT_EQ(voxels.keys.size(), sums.size());
  size_t i = 0;
  for (const auto& [key, sum] : sums) {
    ASSERT_EQ(voxels.keys[i], key);
    EXPECT_EQ(voxels.readings[i], static_cast<uint32_t>(sum.second));
    EXPECT_FLOAT_EQ(voxels.values[0][i], static_cast<float>(sum.first / sum.second));
    ++i;
  }
}

}  // namespace
}  // namespace fovea::sensors
