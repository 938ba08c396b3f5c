#include "engine/render/defaults.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace fovea::render {
namespace {

constexpr int kBins = 1024;

/// The histograms of several steps on one scale.
struct Distribution {
  double low = 0, high = 0;
  std::array<double, kBins> counts{};
  double total = 0;

  [[nodiscard]] double ValueOf(int bin) const { return low + (high - low) * (bin + 0.5) / kBins; }
};

Distribution Gather(std::span<const FieldStats> steps) {
  Distribution all;
  all.low = steps.front().minimum;
  all.high = steps.front().maximum;
  for (const FieldStats& step : steps) {
    all.low = std::min(all.low, step.minimum);
    all.high = std::max(all.high, step.maximum);
  }
  const double range = all.high - all.low;
  for (const FieldStats& step : steps) {
    for (size_t bin = 0; bin < step.histogram.size(); ++bin) {
      const double value =
          step.minimum + (step.maximum - step.minimum) * (static_cast<double>(bin) + 0.5) / 256;
      const double place = range > 0 ? (value - all.low) / range * kBins : 0;
      const int at = std::clamp(static_cast<int>(place), 0, kBins - 1);
      all.counts[at] += static_cast<double>(step.histogram[bin]);
      all.total += static_cast<double>(step.histogram[bin]);
    }
  }
  return all;
}

/// The middle of the fullest bin, or the end of the range where that bin is the first or last:
/// a background is mostly exactly there.
double BackgroundOf(const FieldStats& stats) {
  const auto fullest = std::max_element(stats.histogram.begin(), stats.histogram.end());
  const auto bin = fullest - stats.histogram.begin();
  if (bin == 0) {
    return stats.minimum;
  }
  if (bin == 255) {
    return stats.maximum;
  }
  return stats.minimum + (stats.maximum - stats.minimum) * (static_cast<double>(bin) + 0.5) / 256;
}

/// One side of the ramp away from the background.
struct Side {
  double extent = 0;    // value at full opacity, minus the background; signed
  double voxels = 0;    // farther from the background than the ramp's foot
  double strength = 0;  // sum over them of the ramp's opacity at scale 1
};

constexpr double kFoot = 0.08;  // of the extent: noise of the background stays transparent

double RampOpacity(double fraction) {
  return fraction <= kFoot ? 0.0 : std::min(1.0, (fraction - kFoot) / (1 - kFoot));
}

Side MeasureSide(const Distribution& all, double background, double sign) {
  const double reach = sign > 0 ? all.high - background : background - all.low;
  Side side;
  if (reach <= 0.02 * (all.high - all.low)) {
    return side;
  }
  // Full opacity at the value that all but one voxel in a thousand of this side stay below:
  // a few extreme values must not make the rest invisible.
  std::array<double, kBins> by_distance{};
  double beyond_foot = 0;
  for (int bin = 0; bin < kBins; ++bin) {
    const double distance = sign * (all.ValueOf(bin) - background);
    if (distance > kFoot * reach) {
      const int at = std::min(static_cast<int>(distance / reach * kBins), kBins - 1);
      by_distance[at] += all.counts[bin];
      beyond_foot += all.counts[bin];
    }
  }
  if (beyond_foot <= 0) {
    return side;
  }
  double above = 0;
  int top = kBins - 1;
  while (top > 0 && above + by_distance[top] < 0.001 * beyond_foot) {
    above += by_distance[top--];
  }
  side.extent = sign * reach * (top + 1) / kBins;
  for (int bin = 0; bin < kBins; ++bin) {
    const double opacity = RampOpacity((all.ValueOf(bin) - background) / side.extent);
    side.voxels += opacity > 0 ? all.counts[bin] : 0;
    side.strength += opacity * all.counts[bin];
  }
  return side;
}

/// The ramp's colours, from the foot to full opacity: embers to white.
constexpr std::array<std::pair<double, Color>, 4> kColors = {{
    {kFoot, {0.18F, 0.05F, 0.03F}},
    {0.35, {0.75F, 0.22F, 0.05F}},
    {0.65, {1.0F, 0.62F, 0.18F}},
    {1.0, {1.0F, 0.95F, 0.85F}},
}};

/// The number with three digits after the first that `range` has: defaults are printed for people
/// to copy.
double Rounded(double value, double range) {
  const int digits = 3 - static_cast<int>(std::floor(std::log10(range)));
  const std::string text =
      digits >= 0
          ? fmt::format("{:.{}f}", value, digits)
          : fmt::format("{:.0f}", std::round(value * std::pow(10, digits)) * std::pow(10, -digits));
  return std::strtod(text.c_str(), nullptr);
}

/// Where a sample of LLL_0 stands: the middle of what its super-voxel covers of the volume; of CDF
/// wavelets the first voxel of that.
Vec3 MiddleOfCell(const Hierarchy& hierarchy, Wavelet wavelet, const Int3& cell) {
  Vec3 at;
  const auto width = static_cast<double>(hierarchy.WidthAt(0));
  for (int axis = 0; axis < 3; ++axis) {
    const double first = static_cast<double>(cell[axis]) * width;
    const double end = std::min(first + width, static_cast<double>(hierarchy.dims()[axis]));
    at[axis] = wavelet == Wavelet::kHaar ? 0.5 * (first + end) : std::min(first + 0.5, end);
  }
  return at;
}

}  // namespace

StatusOr<Vec3> DefaultFovea(CoefficientSource& source, const FieldStats& stats,
                            const std::function<bool(const Vec3&)>& accepts) {
  const Hierarchy& hierarchy = source.hierarchy();
  const Int3 dims = hierarchy.DimsAt(0);
  Grid coarse(Box3::OfSize(dims));
  FOVEA_RETURN_IF_ERROR(source.ReadCoarse(coarse.values));
  const double background = BackgroundOf(stats);
  const auto middle = [&](const Int3& cell) {
    return MiddleOfCell(hierarchy, source.basis().wavelet, cell);
  };
  double best = -1;
  double best_accepted = -1;
  Int3 densest;
  std::optional<Int3> accepted;
  for (int64_t z = 0; z < dims.z; ++z) {
    for (int64_t y = 0; y < dims.y; ++y) {
      for (int64_t x = 0; x < dims.x; ++x) {
        double sum = 0;
        const Box3 around =
            Intersect(Box3::OfSize(dims), Box3{{x, y, z}, {x + 1, y + 1, z + 1}}.Grown(1));
        for (int64_t cz = around.lo.z; cz < around.hi.z; ++cz) {
          for (int64_t cy = around.lo.y; cy < around.hi.y; ++cy) {
            for (int64_t cx = around.lo.x; cx < around.hi.x; ++cx) {
              const double own = cx == x && cy == y && cz == z ? 4 : 1;
              sum += own * std::abs(coarse.At(cx, cy, cz) - background);
            }
          }
        }
        if (sum > best) {
          best = sum;
          densest = {x, y, z};
        }
        if (sum > best_accepted && accepts(middle({x, y, z}))) {
          best_accepted = sum;
          accepted = {x, y, z};
        }
      }
    }
  }
  return middle(accepted ? *accepted : densest);
}

double DefaultRate(const Hierarchy& hierarchy) {
  return static_cast<double>(std::min<int64_t>(40, hierarchy.dims().Max()));
}

TransferFunction DefaultTransferFunction(std::span<const FieldStats> steps,
                                         const Hierarchy& hierarchy) {
  constexpr double kTargetDepth = 3;  // optical depth of a ray through the middle of the object
  if (steps.empty()) {
    return {{{0, {1, 1, 1}, 0}}};
  }
  const Distribution all = Gather(steps);
  FieldStats fullest = steps.front();
  for (const FieldStats& step : steps) {
    if (*std::max_element(step.histogram.begin(), step.histogram.end()) >
        *std::max_element(fullest.histogram.begin(), fullest.histogram.end())) {
      fullest = step;
    }
  }
  const double background = BackgroundOf(fullest);
  // Both sides of the background only where values have a sign; a scan's low values are air.
  const bool is_signed =
      all.low < 0 && all.high > 0 && std::abs(background) < 0.05 * (all.high - all.low);
  const bool upwards = all.high - background >= background - all.low;
  const Side below = is_signed || !upwards ? MeasureSide(all, background, -1) : Side();
  const Side above = is_signed || upwards ? MeasureSide(all, background, 1) : Side();
  const double voxels = below.voxels + above.voxels;
  if (voxels <= 0) {
    return {{{background, {1, 1, 1}, 0}}};
  }
  // A compact object of that many voxels is about this long to look through.
  const double share = voxels / all.total;
  const double path = static_cast<double>(hierarchy.dims().Max()) * std::cbrt(share);
  const double mean_opacity = (below.strength + above.strength) / voxels;
  const double sigma = kTargetDepth / std::max(path * mean_opacity, 1.0);
  const double most = std::round(1000 * std::clamp(1 - std::exp(-sigma), 0.002, 0.95)) / 1000;

  TransferFunction transfer;
  const auto add = [&](double fraction, double extent, const Color& color) {
    const double value = Rounded(background + fraction * extent, all.high - all.low);
    const double opacity = Rounded(most * RampOpacity(fraction), most);
    transfer.points.push_back({value, color, static_cast<float>(opacity)});
  };
  for (auto color = kColors.rbegin(); below.extent != 0 && color != kColors.rend(); ++color) {
    add(color->first, below.extent, color->second);
  }
  for (const auto& [fraction, color] : kColors) {
    if (above.extent != 0) {
      add(fraction, above.extent, color);
    }
  }
  return transfer;
}

}  // namespace fovea::render
