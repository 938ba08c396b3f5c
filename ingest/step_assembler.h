#ifndef INGEST_STEP_ASSEMBLER_H_
#define INGEST_STEP_ASSEMBLER_H_

#include <cstdint>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/geometry.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// One field of one step, as it came.
struct FieldVoxels {
  BrickGrid voxels;
  Box3 active;             // of the active voxels, in the file's index space; may exceed the extent
  uint64_t nonfinite = 0;  // NaN and infinities, made background
  uint64_t rounded = 0;    // values that float32 does not hold exactly
};

/// Puts the answer to a ReadRequest together. Trusts nothing: what does not follow the protocol or
/// lies outside the extent is INTERNAL, and memory is counted before it is taken.
class StepAssembler {
 public:
  /// `extent` as in the request, at most kMaxDimension an axis; bricks of `edge`; `fields` as many
  /// as were asked for; RESOURCE_EXHAUSTED rather than more than `max_bytes` of bricks.
  StepAssembler(const Box3& extent, int64_t edge, size_t fields, int64_t max_bytes)
      : extent_(extent), edge_(edge), expected_(fields), bytes_left_(max_bytes) {}

  /// Takes the next reply: kField, kBlock, kTile or kFieldEnd.
  [[nodiscard]] Status Consume(const FrameView& reply);
  /// All fields, in the order of the request; INTERNAL if some are not complete.
  [[nodiscard]] StatusOr<std::vector<FieldVoxels>> Finish();
  /// What is left of max_bytes.
  [[nodiscard]] int64_t bytes_left() const { return bytes_left_; }

 private:
  [[nodiscard]] Status Start(const FieldStart& start);
  [[nodiscard]] Status AddBlock(const Block& block);
  [[nodiscard]] Status AddTile(const Tile& tile);
  /// `box` in the voxel coordinates of the extent; `values` of it, or null: `constant` everywhere.
  /// What is not finite becomes background.
  [[nodiscard]] Status Write(const Box3& box, const char* values, float constant);
  [[nodiscard]] Status FillWithBackground(const Box3& box);
  /// Counts bricks that are about to be made.
  [[nodiscard]] Status TakeBytes(int64_t bricks);
  /// `box` moved to the voxel coordinates of the extent; an error if it is not inside.
  [[nodiscard]] StatusOr<Box3> Inside(const Box3& box) const;

  Box3 extent_;
  int64_t edge_;
  size_t expected_;
  int64_t bytes_left_;
  std::vector<FieldVoxels> fields_;
  bool in_field_ = false;
  float background_ = 0;  // of the field in hand
};

}  // namespace fovea::ingest

#endif  // INGEST_STEP_ASSEMBLER_H_
