#ifndef ENGINE_VOLUME_COEFFICIENT_SET_H_
#define ENGINE_VOLUME_COEFFICIENT_SET_H_

#include <vector>

#include "engine/volume/basis.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/grid.h"
#include "engine/volume/hierarchy.h"

namespace fovea {

/// All wavelet coefficients of one field of one time step, in memory: what the forward transform
/// makes and the store writes. Bricks of zeros are absent.
struct CoefficientSet {
  Hierarchy hierarchy;
  Basis basis;
  /// LLL_0, whole, in data units.
  Grid coarse;
  /// detail[l], l = 0 .. L-1: the seven sub-bands that refine level l into level l+1, as a grid of
  /// DimsAt(l) points with 7 channels. Channel b-1 holds sub-band b = 1..7: bit 0 high in x, bit 1
  /// in y, bit 2 in z.
  std::vector<BrickGrid> detail;
};

}  // namespace fovea

#endif  // ENGINE_VOLUME_COEFFICIENT_SET_H_
