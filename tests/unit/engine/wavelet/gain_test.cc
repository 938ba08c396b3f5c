#include "engine/wavelet/gain.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "engine/wavelet/transform.h"
#include "tests/support/status_matchers.h"

namespace fovea::wavelet {
namespace {

constexpr Wavelet kAll[] = {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97};

/// The voxels of a line from one coefficient of `level`, all else zero.
std::vector<float> Response(Wavelet wavelet, const Hierarchy& hierarchy, int level, int64_t at) {
  std::vector<float> low(static_cast<size_t>(hierarchy.DimsAt(level).x), 0.0F);
  for (int l = level; l < hierarchy.finest(); ++l) {
    const Box3 parents = Box3::OfSize(hierarchy.DimsAt(l));
    Grid parent(parents);
    parent.values = low;
    std::vector<float> detail(static_cast<size_t>(7 * parents.Volume()), 0.0F);
    if (l == level) {
      detail[static_cast<size_t>(at)] = 1;
    }
    Grid child(Box3::OfSize(hierarchy.DimsAt(l + 1)));
    InverseLevel({wavelet, false}, l, parent, parents, detail, hierarchy.DimsAt(l + 1), 1, &child);
    low = child.values;
  }
  return low;
}

/// On a line every coefficient can be tried: the worst signs at each voxel add up to the gain.
TEST(DetailGain, IsTheLargestSumOfWeightsOnALine) {
  for (const Wavelet wavelet : kAll) {
    for (const int64_t n : {128, 127, 100}) {
      ASSERT_OK_AND_ASSIGN(const Hierarchy hierarchy, Hierarchy::Make({n, 1, 1}));
      for (int level = 0; level < hierarchy.finest(); ++level) {
        std::vector<double> sums(static_cast<size_t>(n), 0.0);
        for (int64_t at = 0; at < hierarchy.DimsAt(level).x; ++at) {
          const std::vector<float> response = Response(wavelet, hierarchy, level, at);
          for (size_t i = 0; i < sums.size(); ++i) {
            sums[i] += std::fabs(response[i]);
          }
        }
        const double worst = *std::max_element(sums.begin(), sums.end());
        const double gain = DetailGain(wavelet, hierarchy, level);
        EXPECT_LE(worst, gain * 1.001) << WaveletName(wavelet) << " " << n << " " << level;
        EXPECT_GE(worst, gain * 0.9) << WaveletName(wavelet) << " " << n << " " << level;
      }
    }
  }
}

TEST(DetailGain, IsSevenInAVolumeOfHaarAndCdf53) {
  ASSERT_OK_AND_ASSIGN(const Hierarchy hierarchy, Hierarchy::Make({256, 100, 37}));
  for (int level = 0; level < hierarchy.finest(); ++level) {
    EXPECT_NEAR(DetailGain(Wavelet::kHaar, hierarchy, level), 7, 1e-5);
    EXPECT_NEAR(DetailGain(Wavelet::kCdf53, hierarchy, level), 7, 1e-5);
    EXPECT_GT(DetailGain(Wavelet::kCdf97, hierarchy, level), 7);
    EXPECT_LT(DetailGain(Wavelet::kCdf97, hierarchy, level), 30);
  }
}

}  // namespace
}  // namespace fovea::wavelet
