#include "service/coefficients/plan.h"

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>

#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::coefficients {
namespace {

using ::fovea::testing::FailsWith;

constexpr Int3 kDims{150, 97, 121};

/// How often each place of each level is sent, in one field.
using Places = std::map<std::tuple<int, int64_t, int64_t, int64_t>, int>;

void Count(int level, const Box3& box, Places* places) {
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      for (int64_t x = box.lo.x; x < box.hi.x; ++x) {
        ++(*places)[{level, x, y, z}];
      }
    }
  }
}

bool Covers(const RetainedSet& set, int level, int64_t x, int64_t y, int64_t z) {
  return level == kCoarse || set.window(level).Contains(Int3{x, y, z});
}

class PlanTest : public ::testing::Test {
 protected:
  [[nodiscard]] RetainedSet Set(const Fovea& fovea) const {
    return RetainedSet::Make(info_.hierarchy, fovea).value();
  }

  store::DatasetInfo info_ = store::testing::MakeInfo(kDims, 16, {"density", "heat"});
};

TEST(SubtractTest, WhatIsLeftIsWhatLiesOutside) {
  std::mt19937 random(3);
  const auto box = [&] {
    Box3 made;
    for (int axis = 0; axis < 3; ++axis) {
      made.lo[axis] = static_cast<int64_t>(random() % 10);
      made.hi[axis] = made.lo[axis] + static_cast<int64_t>(random() % 10);
    }
    return made;
  };
  for (int i = 0; i < 300; ++i) {
    const Box3 whole = box();
    const std::vector<Box3> holes{box(), box(), box()};
    std::vector<Box3> left{whole};
    for (const Box3& hole : holes) {
      left = Subtract(std::move(left), hole);
    }
    Places counted;
    for (const Box3& part : left) {
      Count(0, part, &counted);
    }
    Places expected;
    Count(0, whole, &expected);
    std::erase_if(expected, [&](const auto& entry) {
      const auto& [level, x, y, z] = entry.first;
      return std::any_of(holes.begin(), holes.end(), [&](const Box3& hole) {
        return hole.Contains(Int3{x, y, z});
      });
    });
    ASSERT_EQ(counted, expected) << i;  // each once
  }
}

TEST_F(PlanTest, EveryMissingCoefficientIsSentOnceAndNoOther) {
  std::mt19937 random(11);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto fovea = [&] {
    return Fovea{{uniform(0, 150), uniform(0, 97), uniform(0, 121)},
                 Rate(uniform(1, 30), uniform(1, 30), uniform(1, 160))};
  };
  for (int i = 0; i < 6; ++i) {
    PlanRequest request;
    request.fields = {"density", "heat"};
    request.fovea = fovea();
    request.held.resize(random() % 4);
    request.base.resize(random() % 4);
    std::generate(request.held.begin(), request.held.end(), fovea);
    std::generate(request.base.begin(), request.base.end(), fovea);
    ASSERT_OK_AND_ASSIGN(const Plan plan, MakePlan(info_, request));

    Places expected;
    const RetainedSet wanted = Set(request.fovea);
    Count(kCoarse, wanted.box(0), &expected);
    for (int level = 0; level < info_.hierarchy.finest(); ++level) {
      Count(level, wanted.window(level), &expected);
    }
    const auto in_any = [&](const std::vector<Fovea>& foveas, int level, int64_t x, int64_t y,
                            int64_t z) {
      return std::any_of(foveas.begin(), foveas.end(),
                         [&](const Fovea& one) { return Covers(Set(one), level, x, y, z); });
    };
    std::erase_if(expected, [&](const auto& entry) {
      return std::apply([&](auto... at) { return in_any(request.held, at...); }, entry.first);
    });
    int64_t values = 0;
    for (int field = 0; field < 2; ++field) {
      Places sent;
      for (const PlannedBlock& block : plan.blocks) {
        if (block.field != field) {
          continue;
        }
        values += block.Values();
        for (const PlannedBox& box : block.boxes) {
          Count(box.level, box.box, &sent);
          // All of a box with differences is in the base, nothing of another.
          ASSERT_EQ(box.difference,
                    in_any(request.base, box.level, box.box.lo.x, box.box.lo.y, box.box.lo.z));
          ASSERT_EQ(box.difference, in_any(request.base, box.level, box.box.hi.x - 1,
                                           box.box.hi.y - 1, box.box.hi.z - 1));
        }
      }
      ASSERT_EQ(sent, expected) << i;
    }
    EXPECT_EQ(values, plan.coefficients);
  }
}

TEST_F(PlanTest, BlocksKeepWithinTheirLimitsAndRatesGrow) {
  ASSERT_OK_AND_ASSIGN(const Plan plan,
                       MakePlan(info_, {{"density"}, {{75, 50, 60}, 200}, {}, {}}));
  ASSERT_GT(plan.blocks.size(), 10U);
  double reached = 0;
  for (const PlannedBlock& block : plan.blocks) {
    EXPECT_LE(4 * block.Values(), kMaxNumberBytes);
    EXPECT_LE(block.boxes.size(), kMaxBoxes);
    ASSERT_TRUE(block.reached.has_value());
    EXPECT_GE(block.reached->x, reached);
    reached = block.reached->x;
  }
  EXPECT_EQ(reached, 200);
  EXPECT_EQ(plan.coefficients, Set({{75, 50, 60}, 200}).CoefficientCount());
}

TEST_F(PlanTest, NoRateIsReachedBeforeAllOfItIsThere) {
  const Fovea fovea{{75, 50, 60}, 60};
  ASSERT_OK_AND_ASSIGN(const Plan plan, MakePlan(info_, {{"density", "heat"}, fovea, {}, {}}));
  EXPECT_FALSE(plan.reached.has_value());
  std::vector<Places> there(2);
  for (const PlannedBlock& block : plan.blocks) {
    for (const PlannedBox& box : block.boxes) {
      Count(box.level, box.box, &there[static_cast<size_t>(block.field)]);
    }
    if (!block.reached) {
      continue;
    }
    const RetainedSet set = Set({fovea.at, *block.reached});
    for (int level = 0; level < info_.hierarchy.finest(); ++level) {
      Places wanted;
      Count(level, set.window(level), &wanted);
      for (const auto& [place, once] : wanted) {
        ASSERT_TRUE(there[0].contains(place) && there[1].contains(place))
            << FormatRate(*block.reached);
      }
    }
  }
}

TEST_F(PlanTest, NothingIsLeftWhenAllIsHeld) {
  const Fovea fovea{{75, 50, 60}, 30};
  ASSERT_OK_AND_ASSIGN(const Plan plan, MakePlan(info_, {{"density"}, fovea, {fovea}, {}}));
  EXPECT_TRUE(plan.blocks.empty());
  EXPECT_EQ(plan.reached, Rate(30));
}

TEST_F(PlanTest, TypesDoNotShareABlock) {
  info_.fields[0].type = "int16";
  info_.fields[0].scales = {0.5F, 0.25F, 0.125F, 0.125F};  // coarse is float32
  ASSERT_OK_AND_ASSIGN(const Plan plan, MakePlan(info_, {{"density"}, {{75, 50, 60}, 20}, {}, {}}));
  for (const PlannedBlock& block : plan.blocks) {
    std::set<std::string> types;
    for (const PlannedBox& box : block.boxes) {
      types.insert(CodingOf(info_, "density", box.level).type);
    }
    EXPECT_EQ(types.size(), 1U);
  }
}

TEST(StageRatesTest, GrowToTheRateItself) {
  const Hierarchy hierarchy = Hierarchy::Make({256, 256, 256}).value();
  const auto rates = [&](const Rate& rate) {
    std::vector<double> xs;
    for (const Rate& stage : StageRates(hierarchy, rate)) {
      xs.push_back(stage.x);
    }
    return xs;
  };
  EXPECT_THAT(rates(40), ::testing::ElementsAre(5, 7, 10, 14, 20, 28, 40));
  EXPECT_THAT(rates(1), ::testing::ElementsAre(1));
  EXPECT_THAT(rates(65536).back(), 65536);
  EXPECT_THAT(rates(65536).front(), ::testing::AllOf(::testing::Ge(4), ::testing::Le(6)));
  for (const Rate& stage : StageRates(hierarchy, Rate(2, 40, 7.5))) {
    EXPECT_GE(stage.x, 1);
  }
}

TEST_F(PlanTest, BadFoveasAndRatesAreRefused) {
  EXPECT_THAT(MakePlan(info_, {{"density"}, {{-1, 0, 0}, 20}, {}, {}}),
              FailsWith(absl::StatusCode::kInvalidArgument, "fovea"));
  EXPECT_THAT(MakePlan(info_, {{"density"}, {{1, 0, 0}, 0.5}, {}, {}}),
              FailsWith(absl::StatusCode::kInvalidArgument, "rate"));
  EXPECT_THAT(MakePlan(info_, {{"density"}, {{1, 0, 0}, 2}, {{{1, 1, 999}, 2}}, {}}),
              FailsWith(absl::StatusCode::kInvalidArgument, "fovea"));
}

}  // namespace
}  // namespace fovea::coefficients
