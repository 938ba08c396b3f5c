#ifndef ENGINE_WAVELET_HAAR_H_
#define ENGINE_WAVELET_HAAR_H_

#include <array>
#include <cstdint>
#include <span>

#include "engine/volume/geometry.h"
#include "engine/volume/grid.h"
#include "engine/wavelet/transform.h"

/// The Haar wavelet in floats: along each axis a = (p + q)/2, d = (p - q)/2, so that a super-voxel
/// is the mean of its voxels, in data units. Rows and slices of it for those who make super-voxels
/// as they need them.
namespace fovea::wavelet {

/// Forward with the Haar basis.
[[nodiscard]] inline CoefficientSet ForwardHaar(const BrickGrid& voxels, const Hierarchy& hierarchy,
                                                int threads) {
  return Forward(voxels, hierarchy, {}, threads);
}

/// A row of `count` coefficients of each sub-band: [0] is LLL, bit 0 of the index high in x, bit 1
/// in y, bit 2 in z. The axes may be named otherwise, as long as x runs along the row.
using HaarBands = std::array<const float*, 8>;
/// The four rows of children, 2 * count values each: bit 0 of the index odd in y, bit 1 in z.
using HaarRows = std::array<float*, 4>;

/// Children of one row of parents with detail. Rows must not overlap anything else.
void InverseHaarRow(const HaarBands& bands, int64_t count, const HaarRows& rows);

/// The slices 2 * pz and 2 * pz + 1 of `child` (those that it has and that lie inside
/// `child_dims`), from slice pz of the parents and of their detail; otherwise as
/// InverseHaarLevel, positions outside the volume in x and y included. Different slices may be
/// filled at the same time.
void InverseHaarSlices(const Grid& parent, const Box3& window, std::span<const float> detail,
                       const Int3& child_dims, int64_t pz, Grid* child);

/// InverseLevel of the Haar basis; `parent` over at least the parents of child->box that lie
/// inside the volume.
void InverseHaarLevel(const Grid& parent, const Box3& window, std::span<const float> detail,
                      const Int3& child_dims, int threads, Grid* child);

}  // namespace fovea::wavelet

#endif  // ENGINE_WAVELET_HAAR_H_
