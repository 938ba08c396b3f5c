#include "service/coefficients/held_step.h"

#include <gmock/gmock.h>

#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::coefficients {
namespace {

using ::fovea::testing::FailsWith;

constexpr Int3 kDims{70, 61, 53};

class HeldStepTest : public ::testing::Test {
 protected:
  [[nodiscard]] HeldStep Empty(int64_t step = 0) const {
    return {hierarchy_, step, {{"density", {}, 5}}};
  }

  /// A block of one box of the finest detail, all of it `value`.
  [[nodiscard]] std::string Block(const Box3& box, float value, uint64_t step = 0) const {
    BlockHeader header;
    header.step = header.base_step = step;
    header.boxes = {{hierarchy_.finest() - 1, box, false, 1}};
    const std::vector<float> values(static_cast<size_t>(header.Values()), value);
    return EncodeBlock(header, hierarchy_, std::as_bytes(std::span(values)), {}).value();
  }

  [[nodiscard]] float At(const HeldStep& held, const Int3& p) const {
    std::vector<float> values(7);
    held.coefficients(0).detail.back().CopyOut({p, {p.x + 1, p.y + 1, p.z + 1}}, values);
    EXPECT_THAT(values, ::testing::Each(values[0]));
    return values[0];
  }

  const Hierarchy hierarchy_ = Hierarchy::Make(kDims).value();
};

TEST_F(HeldStepTest, BlocksGoWhereTheySay) {
  HeldStep held = Empty();
  ASSERT_OK_AND_ASSIGN(const int64_t values,
                       held.Add(Block({{14, 15, 9}, {19, 18, 12}}, 3), nullptr));
  EXPECT_EQ(values, 7 * 5 * 3 * 3);
  EXPECT_EQ(At(held, {14, 15, 9}), 3);
  EXPECT_EQ(At(held, {18, 17, 11}), 3);
  EXPECT_EQ(At(held, {19, 17, 11}), 0);
  ASSERT_OK(held.Add(Block({{16, 15, 9}, {18, 18, 12}}, 0), nullptr).status());  // zeros count
  EXPECT_EQ(At(held, {15, 15, 9}), 3);
  EXPECT_EQ(At(held, {16, 15, 9}), 0);
}

TEST_F(HeldStepTest, ZerosTakeNoMemory) {
  HeldStep held = Empty();
  ASSERT_OK(held.Add(Block({{0, 0, 0}, {20, 20, 20}}, 0), nullptr).status());
  EXPECT_TRUE(held.coefficients(0).detail.back().bricks().empty());
}

TEST_F(HeldStepTest, BlocksOfAnotherStepOrBaseAreRefused) {
  HeldStep held = Empty(4);
  const std::string block = Block({{0, 0, 0}, {1, 1, 1}}, 1, 3);
  EXPECT_THAT(held.Add(block, nullptr), FailsWith(absl::StatusCode::kDataLoss, "step 3"));
  BlockHeader header;
  header.step = 4;
  header.base_step = 2;
  header.boxes = {{0, {{0, 0, 0}, {1, 1, 1}}, true, 1}};
  const std::vector<float> values(7, 1.5F);
  const auto bytes = std::as_bytes(std::span(values));
  ASSERT_OK_AND_ASSIGN(const std::string from_two, EncodeBlock(header, hierarchy_, bytes, bytes));
  EXPECT_THAT(held.Add(from_two, nullptr),
              FailsWith(absl::StatusCode::kFailedPrecondition, "step 2"));
  const HeldStep other = Empty(3);
  EXPECT_THAT(held.Add(from_two, &other),
              FailsWith(absl::StatusCode::kFailedPrecondition, "step 2"));
  const HeldStep zeros = Empty(2);
  EXPECT_THAT(held.Add(from_two, &zeros),
              FailsWith(absl::StatusCode::kFailedPrecondition, "do not fit"));
}

TEST_F(HeldStepTest, TheOldestFoveaIsForgottenWithWhatOnlyItNeeds) {
  HeldStep held = Empty();
  ASSERT_OK(held.Add(Block({{0, 0, 0}, {16, 16, 16}}, 1), nullptr).status());
  ASSERT_OK(held.Add(Block({{32, 16, 16}, {35, 20, 20}}, 2), nullptr).status());
  held.Complete({{2, 2, 2}, 2});
  for (size_t i = 0; i < HeldStep::kMaxRegions; ++i) {
    EXPECT_TRUE(held.Holds({{2, 2, 2}, 2}));
    held.Complete({{68, 36, 30.0 + 2 * static_cast<double>(i)}, 4});
  }
  EXPECT_EQ(held.regions().size(), HeldStep::kMaxRegions);
  EXPECT_FALSE(held.Holds({{2, 2, 2}, 2}));
  EXPECT_EQ(At(held, {1, 1, 1}), 0);
  EXPECT_EQ(At(held, {33, 17, 17}), 2);
}

TEST_F(HeldStepTest, AGrowingRateIsOneFovea) {
  HeldStep held = Empty();
  for (const double rate : {4.0, 7.0, 10.0, 20.0}) {
    held.Complete({{30, 30, 30}, rate});
  }
  ASSERT_EQ(held.regions().size(), 1U);
  EXPECT_TRUE(held.Holds({{31, 30, 29}, 10}));
  EXPECT_FALSE(held.Holds({{31, 30, 29}, 20}));
}

}  // namespace
}  // namespace fovea::coefficients
