#ifndef ENGINE_FOVEA_RECONSTRUCT_H_
#define ENGINE_FOVEA_RECONSTRUCT_H_

#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/retained_set.h"
#include "engine/fovea/value_blocks.h"
#include "engine/volume/grid.h"

namespace fovea {

/// Super-voxels beyond the box of each level that rendering may read (bilinear needs 2, gradients
/// the third).
inline constexpr int64_t kApron = 3;

/// R(l, x0, r0) for every level: what the renderer draws. Immutable once made; share it freely.
struct SuperVoxels {
  RetainedSet retained;
  /// levels[l].box = B_l grown by kApron on all sides; values stand at the cells' centres. Inside
  /// the volume the apron is the inverse transform with zero detail (Haar, and `fast`: a copy of
  /// the parent); outside it repeats the border. A level whose box is empty has an empty grid.
  std::vector<Grid> levels;
  /// Bounds of each level's values, so that what is transparent can be skipped.
  std::vector<ValueBlocks> blocks;
};

/// A whole volume as one level, that of the voxels: full resolution for the same renderer.
/// `voxels` must start at (0, 0, 0).
[[nodiscard]] SuperVoxels WholeVolume(const Grid& voxels, const Vec3& fovea, int threads);

struct ReconstructStats {
  double read_ms = 0;         // time in the source
  double reconstruct_ms = 0;  // inverse transform
};

/// How far the inverse transform looks beyond a window (Haar: no difference).
enum class Reconstruction {
  kExact,  // as far as the filters reach: values equal the full inverse transform
  kFast,   // not at all: low-pass and detail are mirrored at the window's edge
};

/// The reconstruction phase, O(m): the inverse transform of the kept coefficients, level by level
/// inside the windows only (Yu et al., section 3.1). Values equal the full inverse transform with
/// every dropped coefficient zero. The low-pass samples of CDF 5/3 and 9/7 do not stand at their
/// cells' centres: each level is resampled there (linear; not at the finest, nor past the last
/// sample of an axis). `threads`: 0 for all processors. Errors are the source's.
[[nodiscard]] StatusOr<SuperVoxels> Reconstruct(CoefficientSource& source,
                                                const RetainedSet& retained, int threads,
                                                ReconstructStats* stats = nullptr,
                                                Reconstruction how = Reconstruction::kExact);
/// The same into what a frame before has left: its memory is used again, so that a moving fovea or
/// a sequence allocates nothing for its levels. After an error *volume holds nothing of use.
[[nodiscard]] Status ReconstructInto(CoefficientSource& source, const RetainedSet& retained,
                                     int threads, Reconstruction how, SuperVoxels* volume,
                                     ReconstructStats* stats = nullptr);

/// The voxels of `box` (within the volume) from all coefficients that lead to them: the exact
/// inverse transform. With `retained` given, only its coefficients count: the foveated volume V_f.
[[nodiscard]] StatusOr<Grid> ExtractVoxels(CoefficientSource& source, const Box3& box,
                                           const RetainedSet* retained = nullptr);

}  // namespace fovea

#endif  // ENGINE_FOVEA_RECONSTRUCT_H_
