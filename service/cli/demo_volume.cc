#include "service/cli/demo_volume.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "engine/base/parallel.h"

namespace fovea::cli {
namespace {

constexpr int64_t kBrickEdge = 16;

/// Smooth, repeatable wrinkles of size about 1 and finer; within [-1.2, 1.2].
double Wrinkles(double x, double y, double z) {
  double sum = 0;
  double gain = 0.5;
  double scale = 11;
  for (int octave = 0; octave < 4; ++octave) {
    const double warp = std::sin(0.6 * scale * z + 2 * octave);
    sum += gain * std::sin(scale * x + 1.7 * warp) * std::cos(scale * y - 1.3 * warp) *
           std::sin(scale * z + 1.1 * std::sin(0.8 * scale * (x + y)));
    gain *= 0.65;
    scale *= 2.1;
  }
  return sum;
}

/// Density at a point of the unit cube, z up.
float Density(double x, double y, double z, double phase) {
  constexpr double kTurn = 2 * std::numbers::pi;
  constexpr double kRoughness = 0.6;
  const double top = 0.35 + 0.6 * std::min(1.0, 1.6 * phase);
  if (z > top) {
    return 0;
  }
  // The axis is a helix that widens with height and turns with time.
  const double angle = kTurn * (1.1 * z - 1.5 * phase);
  const double sway = 0.18 * z;
  const double from_axis =
      std::hypot(x - 0.5 - sway * std::cos(angle), y - 0.5 - sway * std::sin(angle));
  const double radius = 0.08 + 0.22 * z;
  if (from_axis > radius * (1 + 1.2 * kRoughness)) {
    return 0;
  }
  const double wrinkles = Wrinkles(x, y, z - 0.8 * phase);
  const double inside = 1 - from_axis / (radius * (1 + kRoughness * wrinkles));
  const double puffs = 0.7 + 0.3 * std::sin(kTurn * (3 * z - 4 * phase));
  const double fade = std::min({1.0, 6 * (top - z), 20 * z});
  const double texture = std::clamp(0.75 + 0.6 * wrinkles, 0.1, 1.0);
  return static_cast<float>(std::clamp(2.5 * inside, 0.0, 1.0) * puffs * fade * texture);
}

}  // namespace

BrickGrid DemoPlume(int64_t edge, double phase, int threads) {
  BrickGrid grid({edge, edge, edge}, kBrickEdge, 1, 0);
  const int64_t bricks = (edge + kBrickEdge - 1) / kBrickEdge;
  std::vector<std::vector<float>> made(static_cast<size_t>(bricks * bricks * bricks));
  ParallelFor(0, bricks * bricks * bricks, 1, threads, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const Int3 at{i % bricks * kBrickEdge, i / bricks % bricks * kBrickEdge,
                    i / (bricks * bricks) * kBrickEdge};
      std::vector<float>& values = made[static_cast<size_t>(i)];
      values.reserve(static_cast<size_t>(kBrickEdge * kBrickEdge * kBrickEdge));
      for (int64_t z = at.z; z < at.z + kBrickEdge; ++z) {
        for (int64_t y = at.y; y < at.y + kBrickEdge; ++y) {
          for (int64_t x = at.x; x < at.x + kBrickEdge; ++x) {
            const double scale = 1 / static_cast<double>(edge);
            values.push_back(Density((static_cast<double>(x) + 0.5) * scale,
                                     (static_cast<double>(y) + 0.5) * scale,
                                     (static_cast<double>(z) + 0.5) * scale, phase));
          }
        }
      }
    }
  });
  for (int64_t i = 0; i < static_cast<int64_t>(made.size()); ++i) {
    std::vector<float>& values = made[static_cast<size_t>(i)];
    if (std::any_of(values.begin(), values.end(), [](float value) { return value != 0; })) {
      grid.Touch({i % bricks, i / bricks % bricks, i / (bricks * bricks)}) = std::move(values);
    }
  }
  return grid;
}

}  // namespace fovea::cli
