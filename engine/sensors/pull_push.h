#ifndef ENGINE_SENSORS_PULL_PUSH_H_
#define ENGINE_SENSORS_PULL_PUSH_H_

#include <cstdint>
#include <span>

#include "engine/base/status.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/coefficient_set.h"
#include "engine/volume/hierarchy.h"

/// Scattered readings to Haar coefficients by pull-push, without a dense volume (the second
/// application of Yu et al.; docs/sensors.md, docs/decisions/0017-sensors.md).
///
/// The filled field, by definition:
/// * A voxel with readings has their mean.
/// * Pull: a super-voxel with readings in it has the mean of its children that have some, each
///   counting once, however many readings it holds.
/// * Push: a voxel without readings has the value of the smallest super-voxel around it that has
///   some, if that is at most `reach_voxels` wide; otherwise the background. Super-voxels go on
///   past the coarsest level until one covers everything.
/// What comes out is what wavelet::ForwardHaar makes of that field, bit for bit, at a cost that
/// follows the voxels with readings times the levels. Within reach a super-voxel's mean over the
/// filled field is its pulled mean, so that a lone reading has no detail at all.
namespace fovea::sensors {

/// Values larger in magnitude cannot be averaged in floats.
inline constexpr float kLargestValue = 1e37F;

struct FillRule {
  int64_t reach_voxels = int64_t{1} << 20;  // everything
  float background = 0;                     // at most kLargestValue in magnitude
};

struct FilledField {
  CoefficientSet coefficients;
  FieldStats stats;  // of the filled field, every voxel counted
  /// Super-voxels that were looked at: at most voxels with readings x (levels + 4).
  int64_t cells = 0;
};

/// `keys`: the voxels with readings, as Morton keys (morton.h), ascending, each once, inside
/// hierarchy.dims(), at least one; `values`: their means, at most kLargestValue in magnitude.
/// Bricks have the edge `brick_edge`: 8, 16 or 32.
[[nodiscard]] FilledField FillField(const Hierarchy& hierarchy, int64_t brick_edge,
                                    std::span<const uint64_t> keys, std::span<const float> values,
                                    const FillRule& rule);

/// How far a value can be trusted: 1 in a voxel with readings; 1/w where the value comes from a
/// super-voxel w voxels wide; 0 out of reach. As coefficients, in the same way.
[[nodiscard]] FilledField FillCoverage(const Hierarchy& hierarchy, int64_t brick_edge,
                                       std::span<const uint64_t> keys, const FillRule& rule);

/// The most bricks that FillField or FillCoverage make of these voxels.
[[nodiscard]] int64_t CountBricks(const Hierarchy& hierarchy, int64_t brick_edge,
                                  std::span<const uint64_t> keys);

}  // namespace fovea::sensors

#endif  // ENGINE_SENSORS_PULL_PUSH_H_
