#include "engine/render/slab_cover.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace fovea::render {
namespace {

/// The cover of a slab over its opacity.
double Share(double length, double opacity) {
  return opacity > 1e-12 ? -std::expm1(length * std::log1p(-opacity)) / opacity : length;
}

/// Coefficients in powers of x / most of the polynomial through `count` Chebyshev points.
std::vector<double> Interpolate(double length, double most, int count) {
  // Newton's divided differences, then expanded.
  std::vector<double> at(static_cast<size_t>(count));
  std::vector<double> slope(at.size());
  for (int i = 0; i < count; ++i) {
    at[i] = 0.5 - 0.5 * std::cos(std::numbers::pi * (i + 0.5) / count);
    slope[i] = Share(length, most * at[i]);
  }
  for (int order = 1; order < count; ++order) {
    for (int i = count - 1; i >= order; --i) {
      slope[i] = (slope[i] - slope[i - 1]) / (at[i] - at[i - order]);
    }
  }
  std::vector<double> powers(at.size());
  for (int i = count - 1; i >= 0; --i) {
    for (int p = count - 1; p > 0; --p) {
      powers[p] = powers[p - 1] - at[i] * powers[p];
    }
    powers[0] = slope[i] - at[i] * powers[0];
  }
  return powers;
}

double WorstError(const std::vector<double>& powers, double length, double most) {
  constexpr int kProbes = 64;
  double worst = 0;
  for (int i = 0; i <= kProbes; ++i) {
    const double x = static_cast<double>(i) / kProbes;
    double value = 0;
    for (size_t p = powers.size(); p-- > 0;) {
      value = value * x + powers[p];
    }
    const double expected = Share(length, most * x);
    worst = std::max(worst, std::abs(value - expected) / expected);
  }
  return worst;
}

}  // namespace

SlabCover::SlabCover(double length, double most) {
  // Beyond this optical depth a polynomial of floats loses what it gains.
  constexpr double kDeepest = 3;
  if (!(most > 0 && most < 1 && length > 0) || -length * std::log1p(-most) > kDeepest) {
    return;
  }
  for (int n = 3; n <= kMostCoefficients; ++n) {
    const std::vector<double> powers = Interpolate(length, most, n);
    if (WorstError(powers, length, most) > kTolerance) {
      continue;
    }
    count = n;
    double scale = 1;
    for (int p = 0; p < n; ++p) {
      coefficients[static_cast<size_t>(n - 1 - p)] = static_cast<float>(powers[p] / scale);
      scale *= most;
    }
    return;
  }
}

}  // namespace fovea::render
