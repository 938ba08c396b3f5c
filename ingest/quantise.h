#ifndef INGEST_QUANTISE_H_
#define INGEST_QUANTISE_H_

#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/coefficient_set.h"
#include "ingest/ingest.h"

/// Coefficients as whole numbers times a scale for each level, so that no voxel that is
/// reconstructed from them is farther off than a tolerance: chosen from what the inverse transform
/// can do to an error, then measured (docs/decisions/0015).
namespace fovea::ingest {

/// Reads '0.01' (data units), '1e-3r' (a part of the range of the first step) or '0.1%' (the same
/// in percent). INVALID_ARGUMENT unless it is finite and above 0, and relative ones below 1.
[[nodiscard]] StatusOr<Tolerance> ParseTolerance(const std::string& text);

/// Chooses type, scales and tolerance of a field by its first step, whose coefficients have the
/// float basis. Room is left for steps with at least four times as large coefficients.
/// INVALID_ARGUMENT, with what can be, if the tolerance is so small that float32 itself does not
/// keep it. Left float32, which is exact: a volume so small that it has no detail; and, of a
/// relative tolerance, a field whose first step has one value only.
[[nodiscard]] Status ChooseScales(const CoefficientSet& set, const FieldStats& stats,
                                  const Tolerance& tolerance, store::FieldInfo* field);

/// Rounds the coefficients to what will be stored. OUT_OF_RANGE if the type of `field` does not
/// hold one.
[[nodiscard]] Status Quantise(const store::FieldInfo& field, CoefficientSet* set, int threads);

/// The largest difference between `voxels` and what `set` gives back: over all bricks that are
/// stored and what lies between them in blocks of 64^3. Elsewhere the choice of scales is the
/// bound.
[[nodiscard]] StatusOr<double> LargestError(const BrickGrid& voxels, const CoefficientSet& set,
                                            int threads);

}  // namespace fovea::ingest

#endif  // INGEST_QUANTISE_H_
