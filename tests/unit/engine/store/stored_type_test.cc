#include "engine/store/stored_type.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::vector<std::byte> RoomFor(const std::vector<float>& values, const Coding& coding) {
  return std::vector<std::byte>(values.size() * static_cast<size_t>(BytesOfType(coding.type)));
}

TEST(StoredType, WholeNumbersTimesTheScaleComeBack) {
  for (const Coding& coding : {Coding{"int16", 1}, Coding{"int16", 0.37F}, Coding{"int32", 1},
                               Coding{"int32", 1.7e-6F}, Coding{"float32", 1}}) {
    const int32_t most = coding.type == "float32" ? 1000 : MostOfType(coding.type);
    std::vector<float> values;
    for (int i = -20; i <= 20; ++i) {  // 41: whole vectors and more
      values.push_back(static_cast<float>(most / 20 * i) * coding.scale);
    }
    values.push_back(static_cast<float>(most) * coding.scale);
    std::vector<std::byte> stored = RoomFor(values, coding);
    ASSERT_OK(ToStored(values, coding, stored));
    std::vector<float> back(values.size());
    FromStored(stored, coding, back);
    EXPECT_EQ(back, values) << coding.type;
  }
}

TEST(StoredType, RefusesWhatItCannotHoldWhereverItStands) {
  const float most16 = 32767, most32 = kMostInteger;
  for (const auto& [coding, bad] : std::vector<std::pair<Coding, std::vector<float>>>{
           {{"int16", 1}, {0.5F, most16 + 1, -most16 - 1, 3e9F, kInfinity, kNan}},
           {{"int16", 0.25F}, {0.3F, most16 / 2, kNan}},
           {{"int32", 1}, {0.5F, most32 + 1, 3e9F, -3e9F, kInfinity, kNan}},
           {{"float32", 1}, {kInfinity, -kInfinity, kNan}}}) {
    for (const float value : bad) {
      for (const size_t at : {0UL, 5UL, 20UL}) {
        std::vector<float> values(21, 1.0F);
        values[at] = value;
        std::vector<std::byte> stored = RoomFor(values, coding);
        EXPECT_THAT(ToStored(values, coding, stored),
                    FailsWith(absl::StatusCode::kInvalidArgument, "coefficient"))
            << coding.type << " " << value << " at " << at;
      }
    }
  }
}

TEST(StoredType, RoundsToTheNearestAndStaysThere) {
  for (const Coding& coding : {Coding{"int16", 0.013F}, Coding{"int32", 3e-7F}}) {
    std::vector<float> values(1001);
    for (size_t i = 0; i < values.size(); ++i) {
      values[i] = std::sin(static_cast<float>(i));
    }
    std::vector<float> rounded = values;
    ASSERT_OK(RoundToStored(coding, rounded));
    for (size_t i = 0; i < values.size(); ++i) {
      // Half a step, and what float arithmetic loses of values up to 1.
      EXPECT_LE(std::fabs(rounded[i] - values[i]), coding.scale / 2 + 1.2e-7F);
    }
    std::vector<std::byte> stored = RoomFor(values, coding);
    EXPECT_OK(ToStored(rounded, coding, stored));
    std::vector<float> again = rounded;
    ASSERT_OK(RoundToStored(coding, again));
    EXPECT_EQ(again, rounded);
    rounded[7] = 32768 * coding.scale * (coding.type == "int32" ? 200.0F : 1.0F);
    EXPECT_THAT(RoundToStored(coding, rounded),
                FailsWith(absl::StatusCode::kOutOfRange, coding.type));
  }
}

TEST(StoredType, FoldsSignsIntoTheLowestBit) {
  std::vector<int16_t> numbers(43);  // whole vectors and more
  for (size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = static_cast<int16_t>(static_cast<int>(i) - 21);
  }
  numbers[3] = std::numeric_limits<int16_t>::min();
  numbers[42] = std::numeric_limits<int16_t>::max();
  std::vector<uint16_t> folded(numbers.size());
  FoldSigns(std::as_bytes(std::span(numbers)), "int16", std::as_writable_bytes(std::span(folded)));
  for (size_t i = 0; i < numbers.size(); ++i) {
    const int v = numbers[i];
    EXPECT_EQ(folded[i], v >= 0 ? 2 * v : -2 * v - 1) << v;
  }
  UnfoldSigns("int16", std::as_writable_bytes(std::span(folded)));
  EXPECT_EQ(std::memcmp(folded.data(), numbers.data(), 2 * numbers.size()), 0);
}

TEST(StoredType, FoldsSignsOfLongNumbersInPlace) {
  std::vector<int32_t> numbers = {0, -1, 1, -2, 1 << 22, -(1 << 22), INT32_MIN, INT32_MAX, -70000};
  numbers.resize(37, -5);
  const std::vector<int32_t> before = numbers;
  const auto bytes = std::as_writable_bytes(std::span(numbers));
  FoldSigns(bytes, "int32", bytes);
  EXPECT_EQ((std::vector<uint32_t>(numbers.begin(), numbers.begin() + 9)),
            (std::vector<uint32_t>{0, 1, 2, 3, 1U << 23, (1U << 23) - 1, UINT32_MAX, UINT32_MAX - 1,
                                   139999}));
  EXPECT_EQ(numbers.back(), 9);
  UnfoldSigns("int32", bytes);
  EXPECT_EQ(numbers, before);
}

TEST(StoredType, FindsTheLargestMagnitude) {
  for (size_t at = 0; at < 40; ++at) {
    std::vector<float> values(40, 1.0F);
    values[at] = -3;
    EXPECT_EQ(LargestMagnitude(values), 3);
    values[at] = -kInfinity;
    EXPECT_EQ(LargestMagnitude(values), kInfinity);
    values[(at + 9) % 40] = kNan;
    EXPECT_FALSE(std::isfinite(LargestMagnitude(values)));
  }
  EXPECT_EQ(LargestMagnitude({}), 0);
}

}  // namespace
}  // namespace fovea::store
