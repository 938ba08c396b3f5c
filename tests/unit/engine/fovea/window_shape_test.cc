#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "engine/fovea/reconstruct.h"
#include "engine/fovea/retained_set.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea {
namespace {

using testing::MakeCoefficients;
using testing::MakeWavyGrid;

constexpr WindowShape kShapes[] = {WindowShape::kCube, WindowShape::kSphere, WindowShape::kSmooth};

template <typename Use>
void ForEachPoint(const Box3& box, const Use& use) {
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      for (int64_t x = box.lo.x; x < box.hi.x; ++x) {
        use(Int3{x, y, z});
      }
    }
  }
}

/// Random volumes with random foveas, rates (every other one an axis each) and shapes.
template <typename Use>
void ForRandomSets(int trials, const Use& use) {
  std::mt19937 random(7);
  for (int trial = 0; trial < trials; ++trial) {
    Int3 dims;
    Vec3 at;
    Vec3 rates;
    for (int axis = 0; axis < 3; ++axis) {
      dims[axis] = std::uniform_int_distribution<int64_t>(1, 50)(random);
      at[axis] = std::uniform_real_distribution<>(0, static_cast<double>(dims[axis]))(random);
      rates[axis] = std::uniform_real_distribution<>(1, trial % 3 == 0 ? 3 : 60)(random);
      if (trial % 5 == 0) {  // on whole numbers, halves and borders, where rounding decides
        at[axis] = std::floor(2 * at[axis]) / 2;
        rates[axis] = std::floor(rates[axis]);
      }
    }
    const Rate rate = trial % 2 == 0 ? Rate(rates.x) : Rate(rates.x, rates.y, rates.z);
    for (const WindowShape shape : kShapes) {
      SCOPED_TRACE(fmt::format("{}x{}x{} at {},{},{} rate {} shape {}", dims.x, dims.y, dims.z,
                               at.x, at.y, at.z, FormatRate(rate), static_cast<int>(shape)));
      use(RetainedSet::Make(Hierarchy::Make(dims).value(), {at, rate, shape}).value());
    }
  }
}

TEST(WindowShapeTest, MIsTheNumberOfWeightsThatAreNotZero) {
  ForRandomSets(60, [](const RetainedSet& set) {
    int64_t kept = set.hierarchy().DimsAt(0).Product();
    for (int level = 0; level < set.hierarchy().finest(); ++level) {
      ForEachPoint(Box3::OfSize(set.hierarchy().DimsAt(level)), [&](const Int3& p) {
        const float weight = set.Weight(level, p);
        EXPECT_TRUE(weight >= 0 && weight <= 1);
        EXPECT_TRUE(weight == 0 || set.window(level).Contains(p));
        kept += weight != 0 ? 7 : 0;
      });
    }
    EXPECT_EQ(set.CoefficientCount(), kept);
  });
}

TEST(WindowShapeTest, NoCoefficientWeighsMoreThanItsParent) {
  ForRandomSets(60, [](const RetainedSet& set) {
    for (int level = 1; level < set.hierarchy().finest(); ++level) {
      ForEachPoint(set.window(level), [&](const Int3& p) {
        ASSERT_LE(set.Weight(level, p), set.Weight(level - 1, {p.x / 2, p.y / 2, p.z / 2}));
      });
    }
  });
}

TEST(WindowShapeTest, WeighMultipliesEveryBandOfAnyBoxByTheWeights) {
  ForRandomSets(30, [](const RetainedSet& set) {
    for (int level = 0; level < set.hierarchy().finest(); ++level) {
      Box3 box = set.window(level);
      if (box.Size().x > 2) {
        ++box.lo.x;
      }
      std::vector<float> detail(static_cast<size_t>(7 * box.Volume()), 2.0F);
      set.Weigh(level, box, detail);
      size_t i = 0;
      for (int band = 0; band < 7; ++band) {
        ForEachPoint(box, [&](const Int3& p) { ASSERT_EQ(detail[i++], 2 * set.Weight(level, p)); });
      }
    }
  });
}

TEST(WindowShapeTest, FromNOnEverythingIsKeptWhateverTheShape) {
  const Hierarchy hierarchy = Hierarchy::Make({50, 33, 41}).value();
  for (const WindowShape shape : kShapes) {
    for (const Rate& rate : {Rate(50), Rate(50, 60, 70)}) {
      ASSERT_OK_AND_ASSIGN(const RetainedSet set,
                           RetainedSet::Make(hierarchy, {{0, 33, 7}, rate, shape}));
      for (int level = 0; level < hierarchy.finest(); ++level) {
        EXPECT_EQ(set.window(level), Box3::OfSize(hierarchy.DimsAt(level)));
        ForEachPoint(set.window(level), [&](const Int3& p) { ASSERT_EQ(set.Weight(level, p), 1); });
      }
    }
  }
}

TEST(WindowShapeTest, AnAxisOfRateNIsKeptWholeAndTheOthersAreNot) {
  const Hierarchy hierarchy = Hierarchy::Make({64, 64, 64}).value();
  ASSERT_OK_AND_ASSIGN(
      const RetainedSet set,
      RetainedSet::Make(hierarchy, {{32, 32, 0}, {10, 20, 64}, WindowShape::kSphere}));
  const Box3 window = set.window(1);
  EXPECT_EQ(window, (Box3{{11, 6, 0}, {21, 26, 32}}));
  // An elliptic cylinder: the same in every slice.
  EXPECT_EQ(set.Weight(1, {12, 15, 0}), 1);
  EXPECT_EQ(set.Weight(1, {12, 15, 31}), 1);
  EXPECT_EQ(set.Weight(1, {11, 6, 15}), 0);
}

TEST(WindowShapeTest, ABallHoldsPiSixthsOfItsCube) {
  const Hierarchy hierarchy = Hierarchy::Make({512, 512, 512}).value();
  const Vec3 middle{256, 256, 256};
  const auto detail_of_finest = [&](const Rate& rate, WindowShape shape) {
    const RetainedSet set = RetainedSet::Make(hierarchy, {middle, rate, shape}).value();
    int64_t count = 0;
    ForEachPoint(set.window(4), [&](const Int3& p) { count += set.Weight(4, p) > 0 ? 1 : 0; });
    return static_cast<double>(count);
  };
  const double ball = std::numbers::pi / 6;
  EXPECT_NEAR(detail_of_finest(60, WindowShape::kSphere), ball * 60 * 60 * 60, 300);
  EXPECT_NEAR(detail_of_finest({60, 30, 80}, WindowShape::kSphere), ball * 60 * 30 * 80, 300);
  EXPECT_EQ(detail_of_finest(60, WindowShape::kSmooth), 60 * 60 * 60);
}

TEST(WindowShapeTest, SmoothWeightsAreOneWithinAndNearlyZeroAtTheBorder) {
  const Hierarchy hierarchy = Hierarchy::Make({512, 512, 512}).value();
  ASSERT_OK_AND_ASSIGN(const RetainedSet set,
                       RetainedSet::Make(hierarchy, {{256, 256, 256}, 40, WindowShape::kSmooth}));
  EXPECT_EQ(set.Weight(4, {118, 128, 137}), 1);  // 9.5 and 10 of 20.5 from the middle
  EXPECT_GT(set.Weight(4, {108, 128, 128}), 0);
  EXPECT_LT(set.Weight(4, {108, 128, 128}), 0.03);
  EXPECT_NEAR(set.Weight(4, {112, 128, 128}), 0.5, 0.1);
}

/// Coefficients that were weighed one by one before anybody reads them.
class WeighedSource final : public CoefficientSource {
 public:
  WeighedSource(CoefficientSource& source, const RetainedSet& retained)
      : source_(source), retained_(retained) {}
  [[nodiscard]] const Hierarchy& hierarchy() const override { return source_.hierarchy(); }
  [[nodiscard]] Status ReadCoarse(std::span<float> out) override { return source_.ReadCoarse(out); }
  [[nodiscard]] Status ReadDetail(int level, const Box3& window, std::span<float> out) override {
    FOVEA_RETURN_IF_ERROR(source_.ReadDetail(level, window, out));
    size_t i = 0;
    for (int band = 0; band < 7; ++band) {
      ForEachPoint(window, [&](const Int3& p) { out[i++] *= retained_.Weight(level, p); });
    }
    return absl::OkStatus();
  }

 private:
  CoefficientSource& source_;
  const RetainedSet& retained_;
};

/// The foveated volume is the inverse transform of all coefficients times their weights, and what
/// is rendered is the foveated volume.
TEST(WindowShapeTest, BothReconstructionsApplyTheWeights) {
  ForRandomSets(12, [](const RetainedSet& retained) {
    const Int3 dims = retained.hierarchy().dims();
    const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
    MemorySource source(set);
    WeighedSource weighed(source, retained);
    const Box3 whole = Box3::OfSize(dims);
    ASSERT_OK_AND_ASSIGN(const Grid expected, ExtractVoxels(weighed, whole));
    ASSERT_OK_AND_ASSIGN(const Grid foveated, ExtractVoxels(source, whole, &retained));
    EXPECT_EQ(foveated.values, expected.values);
    ASSERT_OK_AND_ASSIGN(const SuperVoxels volume, Reconstruct(source, retained, 1));
    const Grid& leaves = volume.levels.back();
    ForEachPoint(Intersect(leaves.box, whole), [&](const Int3& p) {
      ASSERT_EQ(leaves.At(p.x, p.y, p.z), expected.At(p.x, p.y, p.z));
    });
  });
}

}  // namespace
}  // namespace fovea
