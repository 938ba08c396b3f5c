#ifndef ENGINE_WAVELET_TRANSFORM_H_
#define ENGINE_WAVELET_TRANSFORM_H_

#include <cstdint>
#include <span>

#include "engine/volume/basis.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/coefficient_set.h"
#include "engine/volume/geometry.h"
#include "engine/volume/grid.h"
#include "engine/volume/hierarchy.h"

/// The wavelet transforms of Yu et al., section 2: separable, by lifting, low-pass gain 1, any
/// size. All seven sub-bands of a size n have ceil(n/2) entries; the last of an odd size are 0.
/// * Haar: along each axis a = (p + q)/2, d = (p - q)/2; an odd last sample pairs with itself.
/// * CDF 5/3: d = q - (p + p')/2, a = p + (d' + d)/4; CDF 9/7: two more steps. The samples are
///   continued symmetrically about the first and the last one. The low-pass sample k of a level w
///   voxels wide stands at voxel k*w (Haar: at the middle of its cell).
/// * Reversible integer forms of Haar (d = p - q) and 5/3: the same with halves rounded, up where
///   axis + level is odd and down elsewhere. Axes are taken z, y, x, and back x, y, z.
/// Results do not depend on the number of threads. Integers must be less than 2^17 in magnitude:
/// no coefficient is then more than 23 times as large (5/3, all three high), and kMostInteger
/// (basis.h) holds.
namespace fovea::wavelet {

/// Forward transform of the voxels (one channel, dims = hierarchy.dims()). The cost follows the
/// bricks that are stored, not the bounding box. Bricks of the result have the edge of `voxels`;
/// those whose coefficients are all zero are absent. With an integer basis, all voxels and the
/// background must be whole numbers. `threads`: 0 for all processors.
[[nodiscard]] CoefficientSet Forward(const BrickGrid& voxels, const Hierarchy& hierarchy,
                                     const Basis& basis, int threads);

/// Level-l positions that the children in `children` (a box inside child_dims, level l+1) depend
/// on, through LLL_l or its detail.
[[nodiscard]] Box3 ParentsOf(Wavelet wavelet, const Box3& children, const Int3& child_dims);

/// One level of the inverse inside a box. `parent` holds LLL_l; `detail` holds [7][z][y][x] over
/// `window` (level-l coordinates; zero elsewhere). Fills child->values for every position of
/// child->box inside `child_dims`, the size of level l+1; positions outside repeat the border.
/// Exact if parent.box holds ParentsOf(what of child->box lies inside); it must hold at least
/// their centres, position >> 1. Where it reaches less far, all is mirrored at its edge.
void InverseLevel(const Basis& basis, int level, const Grid& parent, const Box3& window,
                  std::span<const float> detail, const Int3& child_dims, int threads, Grid* child);

}  // namespace fovea::wavelet

#endif  // ENGINE_WAVELET_TRANSFORM_H_
