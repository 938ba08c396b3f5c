#ifndef INGEST_DENSE_FIELD_H_
#define INGEST_DENSE_FIELD_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "engine/volume/value_stats.h"
#include "engine/wavelet/forward_stream.h"
#include "ingest/protocol.h"
#include "ingest/slab_ring.h"

namespace fovea::ingest {

/// Whole slices of a dense field, of all of the extent, in the type they came in.
struct DenseSlices {
  wavelet::VoxelSpan values;
  int64_t count = 0;  // slices
  int64_t bytes = 0;
  std::shared_ptr<const void> owner;  // of the memory
};

/// The end of such a field.
struct DenseEnd {
  size_t field = 0;        // whichever the caller means
  FieldStats stats;        // of all voxels of the extent
  uint64_t nonfinite = 0;  // NaN and infinities, made 0
  uint64_t rounded = 0;    // values that float32 does not hold exactly
};

/// Puts the answer to a ReadRequest for one dense field together, to pieces of slices. Trusts
/// nothing: what does not follow the protocol is INTERNAL; slabs are copied out of the memory that
/// is shared before anything in them is looked at.
class DenseField {
 public:
  using OnSlices = std::function<Status(DenseSlices)>;

  /// `extent` as in the request; what the field does not cover of it is 0. Pieces are of `slices`
  /// slices, but for the last; RESOURCE_EXHAUSTED if one takes more than `max_piece_bytes`.
  DenseField(const Box3& extent, int64_t slices, int64_t max_piece_bytes)
      : extent_(extent), size_(extent.Size()), slices_(slices), max_piece_bytes_(max_piece_bytes) {}

  /// The same, for voxels that come from elsewhere: first what comes, then its rows in order (their
  /// bytes may change all the while), then that all came.
  [[nodiscard]] Status Begin(const DenseStart& start);
  [[nodiscard]] Status AddRows(int64_t rows, std::span<const std::byte> bytes,
                               const OnSlices& on_slices);
  [[nodiscard]] Status End(uint64_t rounded, const OnSlices& on_slices);

  /// Whether kDense came: all other replies are for this.
  [[nodiscard]] bool has_begun() const { return has_begun_; }
  /// Takes the next reply: kDense, kSlab or kFieldEnd. `slabs` are the worker's, or null; whole
  /// pieces go to `on_slices`.
  [[nodiscard]] Status Consume(const FrameView& reply, SlabRing* slabs, const OnSlices& on_slices);
  /// INTERNAL unless all rows and the end came.
  [[nodiscard]] StatusOr<DenseEnd> Finish();

 private:
  /// Zeros up to this row of the extent.
  [[nodiscard]] Status PadTo(int64_t row, const OnSlices& on_slices);
  /// Copies rows that lie side by side in the piece as well, to where next_row_ is.
  void Copy(int64_t rows, const std::byte* from);
  void Inspect(std::byte* values, int64_t count);
  [[nodiscard]] Status Deliver(const OnSlices& on_slices);
  [[nodiscard]] int64_t RowsOfPiece() const;

  Box3 extent_;
  Int3 size_;  // of the extent
  int64_t slices_;
  int64_t max_piece_bytes_;
  bool has_begun_ = false;
  bool has_ended_ = false;
  DenseType type_ = DenseType::kUint8;
  int64_t value_bytes_ = 1;
  Box3 box_;  // of what comes, in voxels of the extent
  std::shared_ptr<std::byte> piece_;
  int64_t piece_first_ = 0;  // its first row
  int64_t next_row_ = 0;     // of the extent, counted through all slices
  int64_t came_ = 0;         // rows of box_
  uint64_t nonfinite_ = 0;
  uint64_t rounded_ = 0;
  ValueStats stats_;
};

}  // namespace fovea::ingest

#endif  // INGEST_DENSE_FIELD_H_
