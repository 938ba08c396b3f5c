#ifndef ENGINE_WAVELET_GAIN_H_
#define ENGINE_WAVELET_GAIN_H_

#include "engine/volume/basis.h"
#include "engine/volume/hierarchy.h"

namespace fovea::wavelet {

/// By how much a voxel can change, at most, when every coefficient of the seven sub-bands of
/// `level` (0 .. L-1) changes by at most 1: the largest sum of |weights| with which a voxel depends
/// on them (of the inverse transform in floats). Haar and CDF 5/3: 7 where all axes are halved.
/// CDF 9/7: more, found from the impulse responses of the inverse transform itself.
[[nodiscard]] double DetailGain(Wavelet wavelet, const Hierarchy& hierarchy, int level);

}  // namespace fovea::wavelet

#endif  // ENGINE_WAVELET_GAIN_H_
