#include "ingest/dense_field.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "engine/base/buffers.h"

namespace fovea::ingest {
namespace {

/// What is copied before it is looked at: it is still in the processor's cache then.
constexpr int64_t kCopyBytes = 64 << 10;

template <typename T>
std::span<const T> ValuesAt(const std::byte* bytes, int64_t count) {
  return {reinterpret_cast<const T*>(bytes), static_cast<size_t>(count)};
}

wavelet::VoxelSpan TypedSpan(DenseType type, const std::byte* bytes, int64_t count) {
  switch (type) {
    case DenseType::kUint8:
      return ValuesAt<uint8_t>(bytes, count);
    case DenseType::kInt8:
      return ValuesAt<int8_t>(bytes, count);
    case DenseType::kUint16:
      return ValuesAt<uint16_t>(bytes, count);
    case DenseType::kInt16:
      return ValuesAt<int16_t>(bytes, count);
    case DenseType::kFloat32:
      break;
  }
  return ValuesAt<float>(bytes, count);
}

}  // namespace

Status DenseField::Consume(const FrameView& reply, SlabRing* slabs, const OnSlices& on_slices) {
  if (reply.kind == FrameKind::kDense && !has_begun_) {
    FOVEA_ASSIGN_OR_RETURN(const DenseStart start, DecodeDenseStart(reply));
    return Begin(start);
  }
  if (!has_begun_ || has_ended_) {
    return Internal("malformed message: kind {} out of turn", static_cast<uint32_t>(reply.kind));
  }
  if (reply.kind == FrameKind::kSlab && slabs != nullptr) {
    FOVEA_ASSIGN_OR_RETURN(const SlabRows rows, DecodeSlabRows(reply));
    return AddRows(rows.rows, slabs->Slab(rows.slab), on_slices);
  }
  FOVEA_ASSIGN_OR_RETURN(const FieldEnd end, DecodeFieldEnd(reply));
  return End(end.rounded, on_slices);
}

Status DenseField::End(uint64_t rounded, const OnSlices& on_slices) {
  rounded_ = rounded;
  const Int3 size = box_.Size();
  if (came_ != size.y * size.z) {
    return Internal("malformed message: {} of {} rows of voxels came", came_, size.y * size.z);
  }
  FOVEA_RETURN_IF_ERROR(PadTo(size_.y * size_.z, on_slices));
  stats_.AddConstant(0, static_cast<uint64_t>(size_.Product() - size.Product()));
  has_ended_ = true;
  return absl::OkStatus();
}

StatusOr<DenseEnd> DenseField::Finish() {
  if (!has_ended_) {
    return Internal("malformed message: a field without an end");
  }
  return DenseEnd{0, stats_.Finish(), nonfinite_, rounded_};
}

Status DenseField::Begin(const DenseStart& start) {
  if (start.index != 0 || !extent_.Contains(start.box)) {
    return Internal("malformed message: voxels outside the extent, or of another field");
  }
  has_begun_ = true;
  type_ = start.type;
  value_bytes_ = BytesOf(start.type);
  box_ = start.box;
  for (int axis = 0; axis < 3; ++axis) {
    box_.lo[axis] -= extent_.lo[axis];
    box_.hi[axis] -= extent_.lo[axis];
  }
  const int64_t bytes = RowsOfPiece() * size_.x * value_bytes_;
  if (bytes > max_piece_bytes_) {
    return ResourceExhausted("{} slices of {} x {} voxels need more memory than there is", slices_,
                             size_.x, size_.y);
  }
  return absl::OkStatus();
}

int64_t DenseField::RowsOfPiece() const {
  return std::min(slices_ * size_.y, size_.y * size_.z - piece_first_);
}

Status DenseField::AddRows(int64_t rows, std::span<const std::byte> bytes,
                           const OnSlices& on_slices) {
  const Int3 size = box_.Size();
  const int64_t row_bytes = size.x * value_bytes_;
  if (rows < 1 || rows > size.y * size.z - came_ ||
      rows > static_cast<int64_t>(bytes.size()) / row_bytes) {
    return Internal("malformed message: {} rows of voxels", rows);
  }
  const std::byte* from = bytes.data();
  const int64_t at_once = std::max<int64_t>(1, kCopyBytes / row_bytes);
  while (rows > 0) {
    const int64_t y = came_ % size.y;
    FOVEA_RETURN_IF_ERROR(PadTo((box_.lo.z + came_ / size.y) * size_.y + box_.lo.y + y, on_slices));
    int64_t run = std::min({rows, at_once, size.y - y});
    run = size.x == size_.x ? run : 1;
    run = std::min(run, piece_first_ + RowsOfPiece() - next_row_);
    Copy(run, from);
    from += run * row_bytes;
    came_ += run;
    rows -= run;
    if (next_row_ == piece_first_ + RowsOfPiece()) {
      FOVEA_RETURN_IF_ERROR(Deliver(on_slices));
    }
  }
  return absl::OkStatus();
}

void DenseField::Copy(int64_t rows, const std::byte* from) {
  const int64_t row_bytes = size_.x * value_bytes_;
  if (piece_ == nullptr) {
    piece_ = TakeBytes(static_cast<size_t>(RowsOfPiece() * row_bytes));
  }
  std::byte* const row = piece_.get() + (next_row_ - piece_first_) * row_bytes;
  std::byte* const to = row + box_.lo.x * value_bytes_;
  const int64_t count = rows * box_.Size().x;
  if (box_.Size().x != size_.x) {
    std::memset(row, 0, static_cast<size_t>(row_bytes));
  }
  std::memcpy(to, from, static_cast<size_t>(count * value_bytes_));
  Inspect(to, count);
  next_row_ += rows;
}

void DenseField::Inspect(std::byte* values, int64_t count) {
  if (type_ == DenseType::kFloat32) {
    uint64_t nonfinite = 0;
    auto* const floats = reinterpret_cast<float*>(values);
    for (int64_t i = 0; i < count; ++i) {
      const bool is_finite = std::isfinite(floats[i]);
      nonfinite += is_finite ? 0 : 1;
      floats[i] = is_finite ? floats[i] : 0.0F;
    }
    nonfinite_ += nonfinite;
  }
  std::visit([&](const auto& span) { stats_.Add(span); }, TypedSpan(type_, values, count));
}

Status DenseField::PadTo(int64_t row, const OnSlices& on_slices) {
  const int64_t row_bytes = size_.x * value_bytes_;
  while (next_row_ < row) {
    if (piece_ == nullptr) {
      piece_ = TakeBytes(static_cast<size_t>(RowsOfPiece() * row_bytes));
    }
    const int64_t run = std::min(row, piece_first_ + RowsOfPiece()) - next_row_;
    std::memset(piece_.get() + (next_row_ - piece_first_) * row_bytes, 0,
                static_cast<size_t>(run * row_bytes));
    next_row_ += run;
    if (next_row_ == piece_first_ + RowsOfPiece()) {
      FOVEA_RETURN_IF_ERROR(Deliver(on_slices));
    }
  }
  return absl::OkStatus();
}

Status DenseField::Deliver(const OnSlices& on_slices) {
  const int64_t count = RowsOfPiece() / size_.y;
  const int64_t values = count * size_.y * size_.x;
  DenseSlices slices{TypedSpan(type_, piece_.get(), values), count, values * value_bytes_, piece_};
  piece_ = nullptr;
  piece_first_ = next_row_;
  return on_slices(std::move(slices));
}

}  // namespace fovea::ingest
