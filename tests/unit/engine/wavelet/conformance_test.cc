// What every basis must do, whatever it is.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/fovea/reconstruct.h"
#include "engine/wavelet/transform.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::wavelet {
namespace {

/// Random whole numbers, 0 to 255.
Grid MakeNoise(const Int3& dims, uint32_t seed) {
  std::mt19937 random(seed);
  Grid grid(Box3::OfSize(dims));
  for (float& value : grid.values) {
    value = static_cast<float>(random() % 256);
  }
  return grid;
}

BrickGrid ToBricks(const Grid& grid, int64_t edge, float background) {
  BrickGrid bricks(grid.box.Size(), edge, 1, background);
  bricks.CopyIn(grid.box, grid.values);
  return bricks;
}

CoefficientSet Coefficients(const Grid& grid, const Basis& basis, int64_t edge = 16) {
  return Forward(ToBricks(grid, edge, 0), Hierarchy::Make(grid.box.Size()).value(), basis, 0);
}

std::vector<float> DetailOf(const CoefficientSet& set, int level, const Box3& window) {
  std::vector<float> detail(static_cast<size_t>(7 * window.Volume()));
  set.detail[level].CopyOut(window, detail);
  return detail;
}

/// Sets what lies outside `window` to zero; `detail` holds [7] boxes of `dims`.
void ZeroOutside(const Int3& dims, const Box3& window, std::vector<float>* detail) {
  size_t at = 0;
  for (int band = 0; band < 7; ++band) {
    for (int64_t z = 0; z < dims.z; ++z) {
      for (int64_t y = 0; y < dims.y; ++y) {
        for (int64_t x = 0; x < dims.x; ++x, ++at) {
          (*detail)[at] = window.Contains(Int3{x, y, z}) ? (*detail)[at] : 0.0F;
        }
      }
    }
  }
}

/// All levels of the full inverse transform, with only the coefficients that `retained` keeps.
std::vector<Grid> FullInverse(const CoefficientSet& set, const RetainedSet& retained) {
  std::vector<Grid> levels{set.coarse};
  for (int level = 0; level < set.hierarchy.finest(); ++level) {
    const Int3 dims = set.hierarchy.DimsAt(level);
    const Box3 all = Box3::OfSize(dims);
    std::vector<float> detail = DetailOf(set, level, all);
    ZeroOutside(dims, retained.window(level), &detail);
    Grid child(Box3::OfSize(set.hierarchy.DimsAt(level + 1)));
    InverseLevel(set.basis, level, levels.back(), all, detail, child.box.hi, 1, &child);
    levels.push_back(std::move(child));
  }
  return levels;
}

/// The value at the centre of cell p of a level, as ALGORITHM and reconstruct.h define it.
double AtCentre(const Basis& basis, const Grid& samples, int64_t width, const Int3& p) {
  const auto w = static_cast<double>(width);
  const double f = basis.wavelet == Wavelet::kHaar ? 0 : (w - 1) / (2 * w);
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    Int3 at = p;
    double weight = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const int step = (corner >> axis) & 1;
      at[axis] = std::clamp<int64_t>(p[axis] + step, 0, samples.box.hi[axis] - 1);
      weight *= step == 1 ? f : 1 - f;
    }
    sum += weight * samples.At(at.x, at.y, at.z);
  }
  return sum;
}

class ConformanceTest : public ::testing::TestWithParam<Basis> {
 protected:
  /// How far values up to 255 may be off after a round trip.
  static double Tolerance() { return GetParam().integer ? 0 : 255 * 4e-6; }
};

TEST_P(ConformanceTest, AnySizeComesBack) {
  for (int64_t n = 1; n <= 40; ++n) {
    for (const Int3& dims : {Int3{n, 41 - n, 17}, Int3{17, n, 41 - n}, Int3{41 - n, 33, n}}) {
      const Grid volume = MakeNoise(dims, static_cast<uint32_t>(n));
      const CoefficientSet set = Coefficients(volume, GetParam(), n % 2 == 0 ? 8 : 16);
      MemorySource source(set);
      ASSERT_OK_AND_ASSIGN(const Grid back, ExtractVoxels(source, volume.box));
      for (size_t i = 0; i < volume.values.size(); ++i) {
        ASSERT_NEAR(back.values[i], volume.values[i], Tolerance()) << n << " at " << i;
      }
    }
  }
}

TEST_P(ConformanceTest, ConstantsStayAndHaveNoDetail) {
  for (const Int3& dims : {Int3{40, 33, 17}, Int3{1, 1, 70}, Int3{64, 64, 5}}) {
    const CoefficientSet set = Coefficients(Grid(Box3::OfSize(dims), 200), GetParam());
    for (const float value : set.coarse.values) {
      ASSERT_NEAR(value, 200, 200 * 1e-6);
    }
    for (int level = 0; level < set.hierarchy.finest(); ++level) {
      for (const float d : DetailOf(set, level, Box3::OfSize(set.hierarchy.DimsAt(level)))) {
        ASSERT_NEAR(d, 0, 200 * 1e-6);
      }
    }
  }
}

TEST_P(ConformanceTest, RampsStayRampsAwayFromTheBorder) {
  const Int3 dims{256, 17, 20};
  const Grid volume =
      testing::MakeGrid(dims, [](double x, double, double) { return std::floor(x) * 2; });
  const CoefficientSet set = Coefficients(volume, GetParam());
  // Low-pass samples of CDF wavelets stand at voxel p * w, Haar's in the middle of their cells.
  const double middle = GetParam().wavelet == Wavelet::kHaar ? 15 : 0;
  const double rounding = GetParam().integer ? 1 : 255 * 1e-5;
  for (int64_t x = 7; x < 9; ++x) {
    EXPECT_NEAR(set.coarse.At(x, 1, 1), 32.0 * static_cast<double>(x) + middle, rounding);
  }
}

TEST_P(ConformanceTest, AWindowOfTheInverseEqualsTheWhole) {
  std::mt19937 generator(7);
  const auto random = [&] { return static_cast<int64_t>(generator()); };
  for (int round = 0; round < 60; ++round) {
    const Int3 dims{1 + random() % 32, 1 + random() % 32, 17 + random() % 16};
    const CoefficientSet set =
        Coefficients(MakeNoise(dims, static_cast<uint32_t>(round)), GetParam());
    const Int3 low = set.hierarchy.DimsAt(0);
    const Box3 all = Box3::OfSize(low);
    Box3 window, part;
    for (int axis = 0; axis < 3; ++axis) {
      window.lo[axis] = random() % low[axis];
      window.hi[axis] = window.lo[axis] + random() % 8;
      part.lo[axis] = random() % dims[axis];
      part.hi[axis] = std::min(part.lo[axis] + 1 + random() % 12, dims[axis]);
    }
    window = Intersect(window, all);
    std::vector<float> detail = DetailOf(set, 0, all);
    ZeroOutside(low, window, &detail);
    Grid whole(Box3::OfSize(dims));
    InverseLevel(GetParam(), 0, set.coarse, all, detail, dims, 1, &whole);
    const Box3 parents = ParentsOf(GetParam().wavelet, part, dims);
    ASSERT_TRUE(all.Contains(parents));
    Grid parent(parents);
    BrickGrid coarse = ToBricks(set.coarse, 16, 0);
    coarse.CopyOut(parents, parent.values);
    const std::vector<float> kept =
        window.IsEmpty() ? std::vector<float>() : DetailOf(set, 0, window);
    Grid inner(part);
    InverseLevel(GetParam(), 0, parent, window, kept, dims, 2, &inner);
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        for (int64_t x = part.lo.x; x < part.hi.x; ++x) {
          ASSERT_EQ(inner.At(x, y, z), whole.At(x, y, z)) << x << "," << y << "," << z;
        }
      }
    }
  }
}

TEST_P(ConformanceTest, OutsideTheVolumeTheInverseRepeatsTheBorder) {
  const Int3 dims{19, 20, 21};
  const CoefficientSet set = Coefficients(MakeNoise(dims, 3), GetParam());
  const Box3 all = Box3::OfSize(set.hierarchy.DimsAt(0));
  Grid child(Box3::OfSize(dims).Grown(3));
  InverseLevel(GetParam(), 0, set.coarse, all, DetailOf(set, 0, all), dims, 1, &child);
  EXPECT_EQ(child.At(-3, 5, 6), child.At(0, 5, 6));
  EXPECT_EQ(child.At(21, 22, -1), child.At(18, 19, 0));
  EXPECT_EQ(child.At(4, -2, 23), child.At(4, 0, 20));
}

/// Every super-voxel that the renderer may read, aprons included, at any rate.
TEST_P(ConformanceTest, BoxesAndApronsEqualTheFullInverseOfWhatIsKept) {
  std::mt19937 random(11);
  for (const Int3& dims : {Int3{64, 64, 64}, Int3{33, 47, 61}, Int3{100, 17, 5}, Int3{7, 3, 2}}) {
    const CoefficientSet set = Coefficients(MakeNoise(dims, 5), GetParam());
    MemorySource source(set);
    for (const double rate : {1.0, 2.0, 3.0, 7.0, 14.0, 100.0}) {
      Fovea fovea{{}, rate};
      for (int axis = 0; axis < 3; ++axis) {
        fovea.at[axis] =
            std::uniform_real_distribution<>(0, static_cast<double>(dims[axis]))(random);
      }
      ASSERT_OK_AND_ASSIGN(const RetainedSet retained, RetainedSet::Make(set.hierarchy, fovea));
      ASSERT_OK_AND_ASSIGN(const SuperVoxels volume, Reconstruct(source, retained, 2));
      const std::vector<Grid> full = FullInverse(set, retained);
      for (size_t l = 0; l < volume.levels.size(); ++l) {
        const Grid& level = volume.levels[l];
        const Int3 n = set.hierarchy.DimsAt(static_cast<int>(l));
        for (size_t i = 0; i < level.values.size(); ++i) {
          const Int3 size = level.box.Size();
          const auto at = static_cast<int64_t>(i);
          const Int3 p{std::clamp<int64_t>(level.box.lo.x + at % size.x, 0, n.x - 1),
                       std::clamp<int64_t>(level.box.lo.y + at / size.x % size.y, 0, n.y - 1),
                       std::clamp<int64_t>(level.box.lo.z + at / size.x / size.y, 0, n.z - 1)};
          ASSERT_NEAR(level.values[i],
                      AtCentre(GetParam(), full[l], set.hierarchy.WidthAt(static_cast<int>(l)), p),
                      255 * 1e-5)
              << "level " << l << " rate " << rate << " at " << p.x << "," << p.y << "," << p.z;
        }
      }
    }
  }
}

TEST_P(ConformanceTest, SparseBricksGiveWhatDenseOnesDo) {
  const Int3 dims{100, 70, 90};
  BrickGrid sparse(dims, 8, 1, 31);
  sparse.CopyIn({{40, 33, 8}, {57, 41, 30}}, std::vector<float>(17 * 8 * 22, 77));
  sparse.CopyIn({{96, 60, 88}, {100, 70, 90}}, std::vector<float>(4 * 10 * 2, 200));
  BrickGrid dense = sparse;
  for (int64_t z = 0; z < 12; ++z) {
    for (int64_t y = 0; y < 9; ++y) {
      for (int64_t x = 0; x < 13; ++x) {
        dense.Touch({x, y, z});
      }
    }
  }
  const Hierarchy hierarchy = Hierarchy::Make(dims).value();
  const CoefficientSet a = Forward(sparse, hierarchy, GetParam(), 1);
  const CoefficientSet b = Forward(dense, hierarchy, GetParam(), 2);
  EXPECT_EQ(a.coarse.values, b.coarse.values);
  for (int level = 0; level < hierarchy.finest(); ++level) {
    EXPECT_TRUE(a.detail[level].bricks() == b.detail[level].bricks()) << level;
  }
}

TEST_P(ConformanceTest, TheCostFollowsTheBricksThatAreThere) {
  BrickGrid voxels({4096, 4096, 4096}, 16, 1, 3);
  voxels.Touch({100, 20, 200})[17] = 9;
  const CoefficientSet set = Forward(voxels, Hierarchy::Make(voxels.dims()).value(), GetParam(), 0);
  for (const BrickGrid& level : set.detail) {
    EXPECT_LE(level.bricks().size(), 8U);
  }
  MemorySource source(set);
  ASSERT_OK_AND_ASSIGN(const Grid back,
                       ExtractVoxels(source, {{1600, 320, 3200}, {1616, 336, 3216}}));
  EXPECT_NEAR(back.values[17], 9, 1e-5);
  EXPECT_NEAR(back.values[16], 3, 1e-5);
}

TEST_P(ConformanceTest, ThreadsChangeNothing) {
  const Grid volume = MakeNoise({61, 83, 70}, 9);
  const BrickGrid bricks = ToBricks(volume, 16, 0);
  const Hierarchy hierarchy = Hierarchy::Make(volume.box.Size()).value();
  const CoefficientSet one = Forward(bricks, hierarchy, GetParam(), 1);
  const CoefficientSet two = Forward(bricks, hierarchy, GetParam(), 2);
  EXPECT_EQ(one.coarse.values, two.coarse.values);
  MemorySource source(one);
  const RetainedSet retained = RetainedSet::Make(hierarchy, {{20, 30, 50}, 12}).value();
  SuperVoxels used;  // of another fovea: nothing of it may stay
  const RetainedSet other = RetainedSet::Make(hierarchy, {{60, 5, 9}, 30}).value();
  for (const Reconstruction how : {Reconstruction::kExact, Reconstruction::kFast}) {
    const SuperVoxels a = Reconstruct(source, retained, 1, nullptr, how).value();
    ASSERT_OK(ReconstructInto(source, other, 1, how, &used));
    ASSERT_OK(ReconstructInto(source, retained, 2, how, &used));
    const SuperVoxels b = Reconstruct(source, retained, 2, nullptr, how).value();
    for (size_t level = 0; level < a.levels.size(); ++level) {
      EXPECT_EQ(a.levels[level].values, b.levels[level].values);
      EXPECT_EQ(a.levels[level].values, used.levels[level].values);
    }
  }
  for (int level = 0; level < hierarchy.finest(); ++level) {
    EXPECT_TRUE(one.detail[level].bricks() == two.detail[level].bricks()) << level;
  }
}

/// `fast` is the same where everything is kept and, in any case, away from the windows' edges of
/// every level above.
TEST_P(ConformanceTest, FastDiffersNearWindowEdgesOnly) {
  const Int3 dims{96, 96, 96};
  const CoefficientSet set =
      Coefficients(testing::MakeGrid(dims,
                                     [](double x, double y, double z) {
                                       return std::round(100 + 50 * std::sin(x / 5) +
                                                         40 * std::cos(y / 7 + z / 9));
                                     }),
                   GetParam());
  MemorySource source(set);
  const RetainedSet all = RetainedSet::Make(set.hierarchy, {{48, 48, 48}, 96}).value();
  const SuperVoxels exact_all = Reconstruct(source, all, 1).value();
  const SuperVoxels fast_all = Reconstruct(source, all, 1, nullptr, Reconstruction::kFast).value();
  EXPECT_EQ(exact_all.levels.back().values, fast_all.levels.back().values);
  const RetainedSet some = RetainedSet::Make(set.hierarchy, {{48, 48, 48}, 16}).value();
  const Grid exact = Reconstruct(source, some, 1).value().levels.back();
  const Grid fast =
      Reconstruct(source, some, 1, nullptr, Reconstruction::kFast).value().levels.back();
  double worst = 0;
  for (size_t i = 0; i < exact.values.size(); ++i) {
    worst = std::max<double>(worst, std::abs(exact.values[i] - fast.values[i]));
  }
  EXPECT_LT(worst, 60);
  EXPECT_EQ(worst > 0, GetParam().wavelet != Wavelet::kHaar);
  const int64_t inset = 12;
  const Box3 box = some.box(set.hierarchy.finest());
  for (int64_t x = box.lo.x + inset; x < box.hi.x - inset; ++x) {
    EXPECT_NEAR(exact.At(x, 48, 48), fast.At(x, 48, 48), 1e-4) << x;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Bases, ConformanceTest,
    ::testing::Values(Basis{Wavelet::kHaar, false}, Basis{Wavelet::kCdf53, false},
                      Basis{Wavelet::kCdf97, false}, Basis{Wavelet::kHaar, true},
                      Basis{Wavelet::kCdf53, true}),
    [](const auto& p) {
      return std::string(WaveletName(p.param.wavelet)) + (p.param.integer ? "Integer" : "Float");
    });

/// One line against the published filters, symmetrically extended.
struct Filters {
  Wavelet wavelet;
  std::vector<double> low, high;  // centre tap, then outwards
};

class FilterTest : public ::testing::TestWithParam<Filters> {};

TEST_P(FilterTest, LiftingIsThePublishedFilters) {
  for (int64_t n = 17; n <= 32; ++n) {
    const Grid line = MakeNoise({n, 1, 1}, static_cast<uint32_t>(n));
    const CoefficientSet set = Coefficients(line, {GetParam().wavelet, false});
    const auto filtered = [&](const std::vector<double>& taps, int64_t at) {
      double sum = 0;
      for (int64_t i = -std::ssize(taps) + 1; i < std::ssize(taps); ++i) {
        int64_t x = std::abs(at + i);
        x = x < n ? x : 2 * (n - 1) - x;
        sum += taps[static_cast<size_t>(std::abs(i))] * line.values[static_cast<size_t>(x)];
      }
      return sum;
    };
    const std::vector<float> detail = DetailOf(set, 0, Box3::OfSize(set.hierarchy.DimsAt(0)));
    for (int64_t k = 0; k < (n + 1) / 2; ++k) {
      EXPECT_NEAR(set.coarse.At(k, 0, 0), filtered(GetParam().low, 2 * k), 1e-4) << n << " " << k;
      const double high = 2 * k + 1 < n ? filtered(GetParam().high, 2 * k + 1) : 0;
      EXPECT_NEAR(detail[static_cast<size_t>(k)], high, 1e-4) << n << " " << k;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Published, FilterTest,
    ::testing::Values(Filters{Wavelet::kCdf53, {0.75, 0.25, -0.125}, {1, -0.5}},
                      Filters{Wavelet::kCdf97,
                              {0.6029490182363579, 0.2668641184428723, -0.07822326652898785,
                               -0.01686411844287495, 0.02674875741080976},
                              {1.115087052456994, -0.5912717631142470, -0.05754352622849957,
                               0.09127176311424948}}),
    [](const auto& p) { return std::string(WaveletName(p.param.wavelet)); });

class IntegerTest : public ::testing::TestWithParam<Wavelet> {};

TEST_P(IntegerTest, RoundingDoesNotDrift) {
  const Grid volume = MakeNoise({256, 64, 64}, 21);
  double mean = 0;
  for (const float value : volume.values) {
    mean += value / static_cast<double>(volume.values.size());
  }
  const CoefficientSet set = Coefficients(volume, {GetParam(), true});
  double coarse = 0;
  for (const float value : set.coarse.values) {
    coarse += value / static_cast<double>(set.coarse.values.size());
  }
  // floor((a + b) / 2) everywhere would be 0.25 lower an axis and level: 3 here.
  EXPECT_NEAR(coarse, mean, 0.2);
}

TEST_P(IntegerTest, CoefficientsAreWholeAndFitTheirTypes) {
  for (const float largest : {255.0F, 65535.0F}) {
    Grid volume = MakeNoise({70, 64, 64}, 22);
    for (float& value : volume.values) {
      value = value < 128 ? 0 : largest;
    }
    const CoefficientSet set = Coefficients(volume, {GetParam(), true});
    float most = 0;
    for (const BrickGrid& level : set.detail) {
      for (const auto& [key, brick] : level.bricks()) {
        for (const float value : brick) {
          ASSERT_EQ(value, std::round(value));
          most = std::max(most, std::abs(value));
        }
      }
    }
    EXPECT_LT(most, largest == 255 ? 32767.0F : static_cast<float>(kMostInteger));
    MemorySource source(set);
    ASSERT_OK_AND_ASSIGN(const Grid back, ExtractVoxels(source, volume.box));
    EXPECT_EQ(back.values, volume.values);
  }
}

INSTANTIATE_TEST_SUITE_P(Wavelets, IntegerTest, ::testing::Values(Wavelet::kHaar, Wavelet::kCdf53),
                         [](const auto& p) { return std::string(WaveletName(p.param)); });

TEST(BasisTest, NamesAreReadBack) {
  for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97}) {
    ASSERT_OK_AND_ASSIGN(const Wavelet back, ParseWavelet(WaveletName(wavelet)));
    EXPECT_EQ(back, wavelet);
  }
  EXPECT_THAT(ParseWavelet("db4"),
              testing::FailsWith(absl::StatusCode::kInvalidArgument, "haar, cdf53 or cdf97"));
}

}  // namespace
}  // namespace fovea::wavelet
