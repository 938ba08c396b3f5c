#include "engine/volume/value_stats.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace fovea {
namespace {

/// By the definition, with the range known.
FieldStats Direct(const std::vector<double>& values) {
  FieldStats stats;
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  stats.minimum = *least;
  stats.maximum = *most;
  const double scale = *most > *least ? 256 / (*most - *least) : 0;
  for (const double value : values) {
    ++stats.histogram[std::min<size_t>(static_cast<size_t>((value - *least) * scale), 255)];
  }
  return stats;
}

template <typename T>
void ExpectExact() {
  std::mt19937 random(11);
  ValueStats stats;
  std::vector<double> all;
  for (const size_t size : {1U, 6U, 1000U}) {
    std::vector<T> values(size);
    std::generate(values.begin(), values.end(), [&] { return static_cast<T>(random()); });
    stats.Add(std::span<const T>(values));
    all.insert(all.end(), values.begin(), values.end());
  }
  stats.AddConstant(3, 77);
  all.insert(all.end(), 77, 3.0);
  const FieldStats expected = Direct(all);
  const FieldStats found = stats.Finish();
  EXPECT_EQ(found.minimum, expected.minimum);
  EXPECT_EQ(found.maximum, expected.maximum);
  EXPECT_EQ(found.histogram, expected.histogram);
}

TEST(ValueStatsTest, IntegersAreCountedExactly) {
  ExpectExact<uint8_t>();
  ExpectExact<int8_t>();
  ExpectExact<uint16_t>();
  ExpectExact<int16_t>();
}

/// The histogram of `values` lies between those with borders moved down and up by the bound.
void ExpectWithinBound(const std::vector<float>& values, ValueStats stats) {
  const std::vector<double> all(values.begin(), values.end());
  const FieldStats expected = Direct(all);
  const FieldStats found = stats.Finish();
  EXPECT_EQ(found.minimum, expected.minimum);
  EXPECT_EQ(found.maximum, expected.maximum);
  EXPECT_EQ(std::accumulate(found.histogram.begin(), found.histogram.end(), uint64_t{0}),
            values.size());
  const double range = expected.maximum - expected.minimum;
  uint64_t below = 0;
  for (int bin = 0; bin + 1 < 256; ++bin) {
    below += found.histogram[static_cast<size_t>(bin)];
    const double border = expected.minimum + range * (bin + 1) / 256;
    const double slack = range / ValueStats::kFineBins + std::fabs(border) * 1e-12;
    const auto less = [&](double than) {
      return static_cast<uint64_t>(
          std::count_if(all.begin(), all.end(), [&](double v) { return v < than; }));
    };
    EXPECT_GE(below, less(border - slack)) << bin;
    EXPECT_LE(below, less(border + slack)) << bin;
  }
}

/// What damaged files hold: later values are so large that all earlier ones are in one bin.
TEST(ValueStatsTest, ValuesOfAnySizeAfterSmallOnes) {
  const std::vector<float> small = {1000, 1000.5F, 1001};
  for (const float large :
       {0x1p40F, 0x1p63F, 0x1p64F, 0x1p66F, 0x1p100F, 3e38F, -0x1p64F, -3e38F}) {
    for (const float scale : {1.0F, 1e-20F, 1e-41F}) {
      std::vector<float> all;
      for (const float value : small) {
        all.push_back(value * scale);
      }
      ValueStats stats;
      stats.Add(std::span<const float>(all));
      stats.AddConstant(large, 2);
      all.insert(all.end(), 2, large);
      stats.Add(std::span<const float>(small));
      all.insert(all.end(), small.begin(), small.end());
      SCOPED_TRACE(::testing::Message() << large << " after " << scale);
      ExpectWithinBound(all, stats);
    }
  }
}

TEST(ValueStatsTest, FloatsAreCountedWithinTheBoundHoweverTheyCome) {
  std::mt19937 random(12);
  struct Case {
    double scale, offset, growth;
  };
  for (const Case& c : {Case{1, 0, 1}, Case{1e-30, 0, 1}, Case{1e30, -1e31, 3}, Case{0.01, 300, 1},
                        Case{1e-3, 0, 7}, Case{5, -1000, 0.5}}) {
    ValueStats stats;
    std::vector<float> all;
    double scale = c.scale;
    for (int piece = 0; piece < 12; ++piece, scale *= c.growth) {
      std::normal_distribution<double> value(c.offset + scale * piece, scale);
      std::vector<float> values(50);
      std::generate(values.begin(), values.end(),
                    [&] { return static_cast<float>(value(random)); });
      stats.Add(std::span<const float>(values));
      all.insert(all.end(), values.begin(), values.end());
    }
    ExpectWithinBound(all, stats);
  }
}

TEST(ValueStatsTest, ConstantsAreCountedToo) {
  ValueStats stats;
  stats.AddConstant(2.5F, 1000);
  EXPECT_EQ(stats.Finish().histogram[0], 1000U);
  EXPECT_EQ(stats.Finish().maximum, 2.5);
  std::vector<float> all(1000, 2.5F);
  for (const float value : {3.0F, -8.0F, 2.5F}) {
    stats.AddConstant(value, 10);
    all.insert(all.end(), 10, value);
    ExpectWithinBound(all, stats);
  }
}

TEST(ValueStatsTest, TheWidestRangeOfFloatsIsOne) {
  const float most = std::numeric_limits<float>::max();
  const std::vector<float> values{-most, most, 0, std::numeric_limits<float>::denorm_min()};
  ValueStats stats;
  stats.Add(std::span<const float>(values));
  const FieldStats found = stats.Finish();
  EXPECT_EQ(found.histogram[0], 1U);
  EXPECT_EQ(found.histogram[128], 2U);
  EXPECT_EQ(found.histogram[255], 1U);
}

}  // namespace
}  // namespace fovea
