#ifndef ENGINE_WAVELET_HAAR_H_
#define ENGINE_WAVELET_HAAR_H_

#include <span>

#include "engine/volume/brick_grid.h"
#include "engine/volume/coefficient_set.h"
#include "engine/volume/geometry.h"
#include "engine/volume/grid.h"

/// The Haar wavelet with low-pass gain 1: along each axis a = (p + q)/2, d = (p - q)/2, so that a
/// super-voxel is the mean of its voxels, in data units. An odd last sample pairs with itself.
namespace fovea::wavelet {

/// Forward transform of the voxels (one channel, dims = hierarchy.dims()). The cost follows the
/// bricks that are stored, not the bounding box. Bricks of the result have the edge of `voxels`;
/// those whose coefficients are all zero are absent. `threads`: 0 for all processors.
[[nodiscard]] CoefficientSet ForwardHaar(const BrickGrid& voxels, const Hierarchy& hierarchy,
                                         int threads);

/// One level of the inverse inside a box. `parent` holds level-l values over at least the parents
/// of `child->box` that lie inside the volume; `detail` holds [7][z][y][x] over `window` (level-l
/// coordinates; zero elsewhere). Fills child->values for every position of child->box inside
/// `child_dims`; positions outside repeat the border.
void InverseHaarLevel(const Grid& parent, const Box3& window, std::span<const float> detail,
                      const Int3& child_dims, int threads, Grid* child);

}  // namespace fovea::wavelet

#endif  // ENGINE_WAVELET_HAAR_H_
