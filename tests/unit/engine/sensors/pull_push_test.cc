#include "engine/sensors/pull_push.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/sensors/density.h"
#include "engine/sensors/morton.h"
#include "engine/sensors/step_buffer.h"
#include "engine/wavelet/haar.h"

namespace fovea::sensors {
namespace {

struct Scene {
  Hierarchy hierarchy;
  std::map<uint64_t, float> voxels;  // with readings
  [[nodiscard]] std::vector<uint64_t> Keys() const {
    std::vector<uint64_t> keys;
    for (const auto& [key, value] : voxels) {
      keys.push_back(key);
    }
    return keys;
  }
  [[nodiscard]] std::vector<float> Values() const {
    std::vector<float> values;
    for (const auto& [key, value] : voxels) {
      values.push_back(value);
    }
    return values;
  }
};

Scene RandomScene(const Int3& dims, int readings, uint32_t seed) {
  std::mt19937 random(seed);
  Scene scene;
  scene.hierarchy = *Hierarchy::Make(dims);
  for (int i = 0; i < readings; ++i) {
    Int3 at;
    for (int axis = 0; axis < 3; ++axis) {
      at[axis] = static_cast<int64_t>(random() % static_cast<uint64_t>(dims[axis]));
      if (i % 3 == 0) {
        at[axis] /= 4;  // denser in a corner
      }
    }
    scene.voxels[MortonKey(at)] = static_cast<float>(random() % 100000) / 777.0F - 20;
  }
  return scene;
}

/// Pull-push by the definition, cell by cell of a dense volume: from the whole down, what a cell's
/// children without readings get.
class Dense {
 public:
  Dense(const Scene& scene, const FillRule& rule, bool coverage)
      : scene_(scene),
        rule_(rule),
        coverage_(coverage),
        dims_(scene.hierarchy.dims()),
        grid_(Box3::OfSize(dims_)) {
    int64_t width = 1;
    while (width < dims_.Max()) {
      width *= 2;
    }
    low_ = INFINITY;
    high_ = -INFINITY;
    for (const auto& [key, value] : scene.voxels) {
      low_ = std::min(low_, coverage ? 1 : value);
      high_ = std::max(high_, coverage ? 1 : value);
    }
    Visit({0, 0, 0}, std::max<int64_t>(width, scene.hierarchy.WidthAt(0) * 16));
  }
  [[nodiscard]] BrickGrid Voxels(int64_t edge) const {
    BrickGrid voxels(dims_, edge, 1, 0);
    voxels.CopyIn(grid_.box, grid_.values);
    return voxels;
  }
  [[nodiscard]] float At(const Int3& at) const { return grid_.At(at.x, at.y, at.z); }

 private:
  [[nodiscard]] bool HasReadings(const Box3& box) const {
    return std::any_of(scene_.voxels.begin(), scene_.voxels.end(), [&](const auto& voxel) {
      return box.Contains(MortonPosition(voxel.first));
    });
  }

  /// The value of a cell with readings, whose voxels are filled.
  float Visit(const Int3& lo, int64_t width) {
    if (width == 1) {
      const float value = coverage_ ? 1 : scene_.voxels.at(MortonKey(lo));
      grid_.At(lo.x, lo.y, lo.z) = value;
      return value;
    }
    const int64_t half = width / 2;
    float child[8];
    bool has[8];
    Box3 boxes[8];
    double sum = 0;
    int count = 0;
    for (int i = 0; i < 8; ++i) {
      const Int3 at{lo.x + (i & 1) * half, lo.y + (i >> 1 & 1) * half, lo.z + (i >> 2) * half};
      boxes[i] = Intersect(grid_.box, {at, {at.x + half, at.y + half, at.z + half}});
      has[i] = !boxes[i].IsEmpty() && HasReadings(boxes[i]);
      if (has[i]) {
        child[i] = Visit(at, half);
        sum += child[i];
        ++count;
      }
    }
    const bool within = width <= rule_.reach_voxels;
    const float mean = std::clamp(static_cast<float>(sum / count), low_, high_);
    const float fill = coverage_ ? (within ? 1.0F / static_cast<float>(width) : 0)
                                 : (within ? mean : rule_.background);
    for (int i = 0; i < 8; ++i) {
      if (!has[i]) {
        child[i] = fill;
        FillBox(boxes[i], fill);
      }
    }
    if (width > scene_.hierarchy.WidthAt(0)) {
      return fill;  // above the coarsest level there is no transform
    }
    return HaarMean(lo, half, child);
  }

  float HaarMean(const Int3& lo, int64_t half, float* child) const {
    for (int axis = 0; axis < 3; ++axis) {
      if (lo[axis] + half >= dims_[axis]) {
        for (int i = 0; i < 8; ++i) {
          child[i] = child[i & ~(1 << axis)];
        }
      }
    }
    return ((child[0] + child[1] + (child[2] + child[3])) +
            (child[4] + child[5] + (child[6] + child[7]))) *
           0.125F;
  }

  void FillBox(const Box3& box, float value) {
    for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
      for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
        for (int64_t x = box.lo.x; x < box.hi.x; ++x) {
          grid_.At(x, y, z) = value;
        }
      }
    }
  }

  const Scene& scene_;
  const FillRule& rule_;
  bool coverage_;
  Int3 dims_;
  Grid grid_;
  float low_, high_;
};

void ExpectSame(const CoefficientSet& got, const CoefficientSet& want) {
  ASSERT_EQ(got.hierarchy, want.hierarchy);
  EXPECT_EQ(got.coarse.values, want.coarse.values);
  for (size_t level = 0; level < want.detail.size(); ++level) {
    const Box3 box = Box3::OfSize(want.detail[level].dims());
    std::vector<float> a(static_cast<size_t>(7 * box.Volume())), b(a.size());
    got.detail[level].CopyOut(box, a);
    want.detail[level].CopyOut(box, b);
    EXPECT_EQ(a, b) << "level " << level;
    for (const auto& [key, brick] : got.detail[level].bricks()) {
      EXPECT_TRUE(std::any_of(brick.begin(), brick.end(), [](float v) { return v != 0; }));
    }
  }
}

void ExpectSame(const FieldStats& got, const FieldStats& want) {
  EXPECT_EQ(got.minimum, want.minimum);
  EXPECT_EQ(got.maximum, want.maximum);
  EXPECT_EQ(got.histogram, want.histogram);
}

FilledField FillOf(const Scene& scene, const FillRule& rule, int64_t edge = 8) {
  return FillField(scene.hierarchy, edge, scene.Keys(), scene.Values(), rule);
}

class PullPushTest : public ::testing::TestWithParam<Int3> {};

/// Identity: what is never made dense is bit for bit the transform of what was made dense.
TEST_P(PullPushTest, IsTheHaarTransformOfTheFilledField) {
  for (const int readings : {1, 2, 30, 3000}) {
    const Scene scene = RandomScene(GetParam(), readings, 7 + static_cast<uint32_t>(readings));
    for (const int64_t reach : {int64_t{1}, int64_t{4}, int64_t{5}, int64_t{1} << 20}) {
      const FillRule rule{reach, -31.5F};
      const BrickGrid voxels = Dense(scene, rule, /*coverage=*/false).Voxels(8);
      const FilledField field = FillOf(scene, rule);
      ExpectSame(field.coefficients, wavelet::ForwardHaar(voxels, scene.hierarchy, 1));
      ExpectSame(field.stats, ComputeStats(voxels));

      const BrickGrid covered = Dense(scene, rule, /*coverage=*/true).Voxels(8);
      const FilledField coverage = FillCoverage(scene.hierarchy, 8, scene.Keys(), rule);
      ExpectSame(coverage.coefficients, wavelet::ForwardHaar(covered, scene.hierarchy, 1));
      ExpectSame(coverage.stats, ComputeStats(covered));
      ASSERT_FALSE(HasFailure()) << readings << " readings, reach " << reach;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, PullPushTest,
                         ::testing::Values(Int3{32, 32, 32}, Int3{37, 18, 5}, Int3{65, 1, 33},
                                           Int3{13, 9, 16}, Int3{40, 70, 1}));

/// The pulled mean in doubles, straight from the definition: children that have readings count
/// alike. Within reach the Haar means are these.
TEST(PullPushTest, HaarMeansAreThePulledMeans) {
  const Scene scene = RandomScene({64, 50, 20}, 500, 3);
  std::map<uint64_t, double> cells(scene.voxels.begin(), scene.voxels.end());
  for (int level = scene.hierarchy.finest(); level > 0; --level) {
    std::map<uint64_t, std::pair<double, int>> sums;
    for (const auto& [key, value] : cells) {
      sums[key >> 3].first += value;
      ++sums[key >> 3].second;
    }
    cells.clear();
    for (const auto& [key, sum] : sums) {
      cells[key] = sum.first / sum.second;
    }
  }
  const FilledField field = FillOf(scene, {});
  for (const auto& [key, mean] : cells) {
    const Int3 at = MortonPosition(key);
    EXPECT_NEAR(field.coefficients.coarse.At(at.x, at.y, at.z), mean, 1e-4);
  }
}

TEST(PullPushTest, ConstantReadingsGiveAConstantField) {
  Scene scene = RandomScene({77, 33, 20}, 200, 5);
  for (auto& [key, value] : scene.voxels) {
    value = 0.1F;
  }
  const FilledField field = FillOf(scene, {});
  for (const BrickGrid& detail : field.coefficients.detail) {
    EXPECT_TRUE(detail.bricks().empty());
  }
  EXPECT_THAT(field.coefficients.coarse.values, ::testing::Each(0.1F));
  EXPECT_EQ(field.stats.minimum, 0.1F);
  EXPECT_EQ(field.stats.maximum, 0.1F);
}

TEST(PullPushTest, ALinearFieldMeasuredEverywhereKeepsItsMeans) {
  Scene scene;
  scene.hierarchy = *Hierarchy::Make({32, 32, 32});
  for (uint64_t key = 0; key < 32 * 32 * 32; ++key) {
    const Int3 at = MortonPosition(key);
    scene.voxels[key] = static_cast<float>(2 * at.x - 3 * at.y + at.z);
  }
  const FilledField field = FillOf(scene, {});
  for (int64_t z = 0; z < 16; ++z) {
    for (int64_t x = 0; x < 16; ++x) {
      EXPECT_EQ(field.coefficients.coarse.At(x, 5, z),
                static_cast<float>(2 * (2 * x) + 1 - 3 * 10 - 1.5 + 2 * z + 0.5));
    }
  }
  const FilledField coverage = FillCoverage(scene.hierarchy, 8, scene.Keys(), {});
  EXPECT_THAT(coverage.coefficients.coarse.values, ::testing::Each(1.0F));
  EXPECT_EQ(coverage.stats.minimum, 1);
}

/// Coverage by its own words: 1/w, w the width of the smallest super-voxel with readings.
TEST(PullPushTest, CoverageIsOneOverTheWidth) {
  const Scene scene = RandomScene({40, 24, 33}, 40, 11);
  const Dense dense(scene, {}, /*coverage=*/true);
  for (int64_t z = 0; z < 33; ++z) {
    for (int64_t y = 0; y < 24; ++y) {
      for (int64_t x = 0; x < 40; ++x) {
        float width = 1;
        for (uint64_t up = MortonKey({x, y, z}), shift = 0;; up >>= 3, shift += 3, width *= 2) {
          const auto first = scene.voxels.lower_bound(up << shift);
          if (first != scene.voxels.end() && first->first >> shift == up) {
            break;
          }
        }
        ASSERT_EQ(dense.At({x, y, z}), 1 / width) << x << "," << y << "," << z;
      }
    }
  }
}

/// A lone reading is the whole field; memory and work know nothing of the box.
TEST(PullPushTest, WorkFollowsTheReadingsNotTheBox) {
  const Int3 dims{65536, 65536, 65536};
  const Scene lone = RandomScene(dims, 1, 1);
  EXPECT_EQ(FillOf(lone, {}).cells, 12);
  EXPECT_EQ(FillOf(lone, {}).stats.histogram[0], uint64_t{1} << 48);
  const Scene scene = RandomScene(dims, 1000, 1);
  const FilledField field = FillOf(scene, {});
  const FilledField coverage = FillCoverage(scene.hierarchy, 8, scene.Keys(), {});
  EXPECT_LE(field.cells, 1000 * 12);
  int64_t bricks = 0;
  for (const BrickGrid& detail : coverage.coefficients.detail) {
    bricks += std::ssize(detail.bricks());
  }
  EXPECT_LE(bricks, 1000 * 12);
  EXPECT_EQ(bricks, CountBricks(scene.hierarchy, 8, scene.Keys()));
  // Twice the readings: at most twice the cells.
  EXPECT_LE(FillOf(RandomScene(dims, 2000, 1), {}).cells, 2 * field.cells);
}

TEST(MortonTest, GoesThereAndBack) {
  for (const Int3& at : {Int3{0, 0, 0}, Int3{65535, 65535, 65535}, Int3{1, 2, 3},
                         Int3{40000, 17, 65535}, Int3{0, 65535, 0}}) {
    EXPECT_EQ(MortonPosition(MortonKey(at)), at);
  }
  EXPECT_EQ(MortonKey({1, 0, 0}), 1U);
  EXPECT_EQ(MortonKey({0, 1, 0}), 2U);
  EXPECT_EQ(MortonKey({0, 0, 1}), 4U);
}

TEST(DensityTest, FoveaLiesInTheClusterAndTheRateReaches) {
  std::mt19937 random(5);
  std::normal_distribution<double> near(100, 5);
  StepBuffer buffer(1, Duplicates::kMean);
  const float value = 1;
  for (int i = 0; i < 10000; ++i) {
    const auto part = [&] {
      return i % 20 == 0 ? static_cast<int64_t>(random() % 512)
                         : std::clamp<int64_t>(static_cast<int64_t>(near(random)), 0, 511);
    };
    buffer.Add(MortonKey({part(), part(), part()}), static_cast<uint64_t>(i), &value);
  }
  const Hierarchy hierarchy = *Hierarchy::Make({512, 512, 512});
  const Density density = MeasureDensity(hierarchy, buffer.Measure());
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(density.fovea[axis], 100, 2);
  }
  EXPECT_GT(density.rate, 8);   // 90 % of all are 95 % of the cluster
  EXPECT_LT(density.rate, 25);  // of normal distributions of deviation 5
}

}  // namespace
}  // namespace fovea::sensors
