// Rendering while reconstructing gives what rendering of kept super-voxels gives.
#include "engine/render/fused.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "engine/fovea/reconstruct.h"
#include "tests/support/pictures.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::render {
namespace {

using testing::Colorful;
using testing::MakeCoefficients;
using testing::MakeGrid;
using testing::MakeWavyGrid;

/// The largest difference of anything that two sets of layers hold.
double LargestDifference(const std::vector<Layer>& a, const std::vector<Layer>& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest = 0;
  for (size_t l = 0; l < a.size(); ++l) {
    EXPECT_EQ(a[l].plan.rect, b[l].plan.rect);
    EXPECT_EQ(a[l].split, b[l].split);
    for (const auto side : {&Layer::front, &Layer::back}) {
      for (const auto plane : {&Gathered::red, &Gathered::green, &Gathered::blue,
                               &Gathered::transmittance, &Gathered::depth}) {
        for (size_t i = 0; i < a[l].split.size(); ++i) {
          largest = std::max(largest, static_cast<double>(std::abs((a[l].*side.*plane)[i] -
                                                                   (b[l].*side.*plane)[i])));
        }
      }
    }
  }
  return largest;
}

struct Case {
  Int3 dims;
  Fovea fovea;
};

RenderSettings RandomSettings(std::mt19937* random, int trial) {
  RenderSettings settings;
  settings.view.azimuth_deg = std::uniform_real_distribution<>(-180, 180)(*random);
  settings.view.elevation_deg = std::uniform_real_distribution<>(-90, 90)(*random);
  settings.transfer = Colorful(trial % 2 == 0 ? 0.04F : 0.4F);
  settings.color_transfer = {{{-1, {1, 0, 0}, 0}, {1, {0, 0, 1}, 0}}};
  settings.lighting.enabled = trial % 3 == 1;
  settings.weighting.kind = static_cast<Weighting::Kind>(trial % 4 == 3 ? 1 : 0);
  settings.compositing = trial % 5 == 4 ? Compositing::kMaximum : Compositing::kEmissionAbsorption;
  settings.threads = 1;
  return settings;
}

TEST(FusedTest, TheSameLayersAsTwoPhases) {
  std::mt19937 random(17);
  int trial = 0;
  for (const Case& c :
       {Case{{70, 61, 83}, {{30, 30, 40}, 12}}, Case{{64, 64, 64}, {{2, 60, 33}, 7}},
        Case{{130, 37, 90}, {{120, 20, 45.5}, 17.4}},
        Case{{64, 64, 64}, {{20, 30, 33}, 18, WindowShape::kSphere}},
        Case{{64, 50, 64}, {{20, 30, 33}, 11, WindowShape::kSmooth}},
        Case{{20, 33, 12}, {{10, 30, 6}, 1}}, Case{{16, 9, 12}, {{8, 3, 6}, 5}},
        Case{{50, 60, 40}, {{25, 30, 20}, 60}}}) {
    const CoefficientSet set = MakeCoefficients(MakeWavyGrid(c.dims));
    const CoefficientSet second_set =
        MakeCoefficients(MakeGrid(c.dims, [](double x, double y, double z) {
          return std::sin(0.2 * x) * std::cos(0.15 * y + 0.1 * z);
        }));
    MemorySource source(set);
    MemorySource second(second_set);
    const RetainedSet retained = RetainedSet::Make(set.hierarchy, c.fovea).value();
    const SuperVoxels volume = Reconstruct(source, retained, 1).value();
    const SuperVoxels second_volume = Reconstruct(second, retained, 1).value();
    for (int i = 0; i < 7; ++i, ++trial) {
      RenderSettings settings = RandomSettings(&random, trial);
      const bool two = trial % 3 == 2;
      const ShearView view = FactorView(settings.view, c.dims, Matrix4{}, 60, 60);
      const auto difference = [&] {
        uint64_t samples = 0;
        FusedStats stats;
        const std::vector<Layer> kept = TraceThickRays(volume, two ? &second_volume : nullptr, view,
                                                       Matrix4{}, settings, &samples);
        TraceScratch fused;
        EXPECT_OK(TraceFused(source, two ? &second : nullptr, retained, view, Matrix4{}, settings,
                             &fused, &stats));
        EXPECT_EQ(stats.samples, samples);
        return LargestDifference(kept, fused.layers);
      };
      settings.spent_transmittance = 0;
      EXPECT_EQ(difference(), 0) << "trial " << trial;
    }
  }
}

/// Opaque things end rays early, at other places than in two phases, and nobody sees it.
TEST(FusedTest, SpentRaysEndWithinTheirLimit) {
  const Int3 dims{96, 80, 70};
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
  MemorySource source(set);
  const RetainedSet retained = RetainedSet::Make(set.hierarchy, {{60, 40, 35}, 14}).value();
  std::mt19937 random(3);
  for (int trial = 0; trial < 6; ++trial) {
    RenderSettings settings = RandomSettings(&random, trial);
    settings.transfer = Colorful(0.6F);
    settings.compositing = Compositing::kEmissionAbsorption;
    ASSERT_OK_AND_ASSIGN(const Image fused, RenderFused(source, retained, Matrix4{}, settings));
    settings.spent_transmittance = 0;
    ASSERT_OK_AND_ASSIGN(const Image exact, RenderFused(source, retained, Matrix4{}, settings));
    double largest = 0;
    for (size_t i = 0; i < exact.rgba.size(); ++i) {
      largest = std::max(largest, static_cast<double>(std::abs(exact.rgba[i] - fused.rgba[i])));
    }
    EXPECT_LT(largest, 2.0 / 4096) << "trial " << trial;
  }
}

/// What is held at one time does not grow with the volume but for a level more.
TEST(FusedTest, MemoryFollowsTheRate) {
  uint64_t before = 0;
  for (const int64_t n : {64, 128, 256}) {
    const CoefficientSet set = MakeCoefficients(
        MakeGrid({n, n, n}, [](double x, double y, double) { return std::sin(x * y); }));
    MemorySource source(set);
    const double middle = static_cast<double>(n) / 2;
    const RetainedSet retained =
        RetainedSet::Make(set.hierarchy, {{middle, middle, middle}, 12}).value();
    RenderSettings settings;
    settings.transfer = Colorful(0.1F);
    const ShearView view = FactorView(settings.view, {n, n, n}, Matrix4{}, 60, 60);
    FusedStats stats;
    TraceScratch scratch;
    ASSERT_OK(TraceFused(source, nullptr, retained, view, Matrix4{}, settings, &scratch, &stats));
    if (before != 0) {
      EXPECT_LT(stats.peak_bytes, before + 16 * 12 * 12 * 60) << n;
    }
    before = stats.peak_bytes;
  }
}

}  // namespace
}  // namespace fovea::render
