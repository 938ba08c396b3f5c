#include "service/server/rate_chooser.h"

#include <algorithm>

namespace fovea::server {
namespace {

constexpr double kRung = 1.6;
constexpr double kLeastRate = 4;
/// A last picture that costs at most this much more than the next rung comes in its place.
constexpr double kHardlyMore = 2;

// Of a frame with reading and encoding (docs/performance.md).
constexpr double kMsPerFrame = 1;
constexpr double kMsPerSuperVoxel = 20e-6;
constexpr double kMsPerPixel = 40e-6;

/// How much of a new measurement is believed, and how far one may move the estimate.
constexpr double kBelief = 0.5;
constexpr double kLeastSlowness = 0.05, kMostSlowness = 50;

double LowestPart(const RateChooser::View& view) {
  const Rate& rate = view.fovea.rate;
  const double largest = std::max({rate.x, rate.y, rate.z});
  const Int3& dims = view.hierarchy.dims();
  const auto side = static_cast<double>(std::max({dims.x, dims.y, dims.z}));
  return std::min(1.0, kLeastRate / std::min(largest, side));
}

}  // namespace

Rate RateChooser::RateOf(double part, const View& view) {
  const Rate& rate = view.fovea.rate;
  if (part >= 1) {
    return rate;
  }
  // From the volume's largest dimension on everything is kept: rungs above it are all the same.
  const Int3& dims = view.hierarchy.dims();
  const auto side = static_cast<double>(std::max({dims.x, dims.y, dims.z}));
  const auto scaled = [&](double along) { return std::max(1.0, part * std::min(along, side)); };
  return {scaled(rate.x), scaled(rate.y), scaled(rate.z)};
}

double RateChooser::Nominal(double part, const View& view) {
  Fovea fovea = view.fovea;
  fovea.rate = RateOf(part, view);
  const auto retained = RetainedSet::Make(view.hierarchy, fovea);
  const int64_t super_voxels = retained.ok() ? retained->SuperVoxelCount() : 0;
  return kMsPerFrame + kMsPerSuperVoxel * static_cast<double>(super_voxels) +
         kMsPerPixel * static_cast<double>(view.pixels);
}

double RateChooser::Within(double ms, const View& view) const {
  const double lowest = LowestPart(view);
  double part = 1;
  while (part > lowest && Expected(part, view) > ms) {
    part = std::max(part / kRung, lowest);
  }
  return part;
}

double RateChooser::Next(double part, const View& view) const {
  const double next = part * kRung;
  return next >= 1 || Nominal(1, view) <= kHardlyMore * Nominal(next, view) ? 1 : next;
}

void RateChooser::Learn(double part, const View& view, double took_ms) {
  const double measured = std::clamp(took_ms / Nominal(part, view), kLeastSlowness, kMostSlowness);
  slowness_ += kBelief * (measured - slowness_);
}

}  // namespace fovea::server
