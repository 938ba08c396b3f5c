#include "engine/wavelet/gain.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/volume/grid.h"
#include "engine/wavelet/transform.h"

namespace fovea::wavelet {
namespace {

/// Coefficients of the line whose impulse responses are taken: more than the filters' supports at
/// both ends and in between.
constexpr int64_t kLine = 24;
/// Levels that a response is followed through: then it has its limit to three digits.
constexpr int kDepth = 6;

/// The largest sums over a line of |response| to low-pass and to high-pass coefficients.
struct LineGain {
  double low = 0, high = 0;
};

/// One level of the inverse of a line of `values` low-pass coefficients.
std::vector<float> Inverse(Wavelet wavelet, const std::vector<float>& low,
                           const std::vector<float>& high, bool odd) {
  const auto count = static_cast<int64_t>(low.size());
  const Box3 parents{{0, 0, 0}, {count, 1, 1}};
  const Int3 child_dims{2 * count - (odd ? 1 : 0), 1, 1};
  Grid parent(parents);
  parent.values = low;
  std::vector<float> detail(7 * low.size());
  std::copy(high.begin(), high.end(), detail.begin());  // band 1: high along x
  Grid child(Box3::OfSize(child_dims));
  InverseLevel({wavelet, false}, 0, parent, parents, detail, child_dims, 1, &child);
  return child.values;
}

/// Of coefficients `depth` levels above the voxels, along an axis that is halved so often.
LineGain GainOfLine(Wavelet wavelet, int depth, bool odd) {
  std::vector<double> sums[2];
  for (int high = 0; high < 2; ++high) {
    for (int64_t at = 0; at < kLine; ++at) {
      if (high == 1 && odd && at == kLine - 1) {
        continue;  // an odd line has no such coefficient
      }
      std::vector<float> impulse(kLine, 0.0F);
      impulse[static_cast<size_t>(at)] = 1;
      const std::vector<float> none(kLine, 0.0F);
      std::vector<float> response =
          high == 1 ? Inverse(wavelet, none, impulse, odd) : Inverse(wavelet, impulse, none, odd);
      for (int level = 1; level < depth; ++level) {
        response = Inverse(wavelet, response, std::vector<float>(response.size(), 0.0F), odd);
      }
      sums[high].resize(response.size());
      for (size_t i = 0; i < response.size(); ++i) {
        sums[high][i] += std::fabs(response[i]);
      }
    }
  }
  return {*std::max_element(sums[0].begin(), sums[0].end()),
          *std::max_element(sums[1].begin(), sums[1].end())};
}

}  // namespace

double DetailGain(Wavelet wavelet, const Hierarchy& hierarchy, int level) {
  const int depth = std::min(hierarchy.finest() - level, kDepth);
  const LineGain even = GainOfLine(wavelet, depth, /*odd=*/false);
  const LineGain odd = GainOfLine(wavelet, depth, /*odd=*/true);
  const LineGain gain{std::max(even.low, odd.low), std::max(even.high, odd.high)};
  double all = 1;
  double low = 1;
  const Int3 children = hierarchy.DimsAt(level + 1);
  for (int axis = 0; axis < 3; ++axis) {
    // A line of one sample is its own low-pass, and stays so: only longer ones have high-pass.
    if (children[axis] > 1) {
      all *= gain.low + gain.high;
      low *= gain.low;
    }
  }
  return all - low;
}

}  // namespace fovea::wavelet
