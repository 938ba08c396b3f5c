#ifndef INGEST_QUANTISED_STEP_H_
#define INGEST_QUANTISED_STEP_H_

#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset_writer.h"
#include "engine/volume/basis.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/hierarchy.h"
#include "ingest/step_reader.h"

namespace fovea::ingest {

/// The fields of one step that are stored quantised: gathered whole, since they are compared with
/// what their coefficients give back before anything is committed.
class QuantisedStep {
 public:
  /// `fields` by name; bricks of `edge`.
  QuantisedStep(std::vector<std::string> fields, const Hierarchy& hierarchy, const Basis& basis,
                int64_t edge, int threads);

  void Add(size_t field, BrickGrid voxels) { voxels_[field] = std::move(voxels); }
  void Add(const DensePiece& piece);
  /// How every field is to be stored, if this is the first step. Errors as ChooseScales.
  [[nodiscard]] StatusOr<std::vector<store::FieldInfo>> ChooseCodings(
      const Tolerance& tolerance) const;
  /// Quantises, measures and writes every field of the writer's step in hand. OUT_OF_RANGE if a
  /// coefficient is too large for what the store has.
  [[nodiscard]] Status Write(store::DatasetWriter* writer);

 private:
  [[nodiscard]] Status WriteField(const store::FieldInfo& field, const BrickGrid& voxels,
                                  store::DatasetWriter* writer) const;

  std::vector<std::string> fields_;
  Hierarchy hierarchy_;
  Basis basis_;
  int threads_;
  std::vector<BrickGrid> voxels_;    // by field
  std::vector<int64_t> next_slice_;  // by field, of dense ones
};

/// Adds a warning for each field that ChooseCodings could choose no scales for.
void WarnOfExact(const std::vector<store::FieldInfo>& codings, std::vector<std::string>* warnings);

}  // namespace fovea::ingest

#endif  // INGEST_QUANTISED_STEP_H_
