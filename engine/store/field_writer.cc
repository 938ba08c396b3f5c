#include "engine/store/field_writer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/store/stored_type.h"

namespace fovea::store {
namespace {

using Bricks = BrickGrid::BrickMap::const_iterator;

/// The brick with zeros past the border of its level.
BrickGrid::Brick CutAtBorder(const BrickGrid::Brick& brick, int64_t edge, const Int3& size) {
  BrickGrid::Brick cut(brick.size(), 0.0F);
  for (int64_t band = 0; band < kSubBands; ++band) {
    for (int64_t z = 0; z < size.z; ++z) {
      for (int64_t y = 0; y < size.y; ++y) {
        const int64_t row = ((band * edge + z) * edge + y) * edge;
        std::copy_n(brick.data() + row, size.x, cut.data() + row);
      }
    }
  }
  return cut;
}

Status AddBrick(int level, const BrickGrid& detail, const Int3& at, const BrickGrid::Brick& brick,
                FieldWriter* writer) {
  const int64_t edge = detail.edge();
  const Int3 size = Intersect(Box3::OfSize(detail.dims()),
                              {{at.x * edge, at.y * edge, at.z * edge},
                               {(at.x + 1) * edge, (at.y + 1) * edge, (at.z + 1) * edge}})
                        .Size();
  BrickGrid::Brick cut;
  const BrickGrid::Brick* values = &brick;
  if (size != Int3{edge, edge, edge}) {
    cut = CutAtBorder(brick, edge, size);
    values = &cut;
  }
  const float largest = LargestMagnitude(*values);
  if (largest == 0) {
    return absl::OkStatus();
  }
  const Coding& coding = writer->coding(level);
  if (!IsIntegerType(coding.type) || !std::isfinite(largest)) {
    return writer->Add(level, at, std::as_bytes(std::span(*values)), largest);
  }
  std::vector<std::byte> stored(values->size() * static_cast<size_t>(BytesOfType(coding.type)));
  FOVEA_RETURN_IF_ERROR(ToStored(*values, coding, stored));
  return writer->Add(level, at, stored, largest);
}

/// The bricks of one layer, on all processors.
Status AddLayer(int level, const BrickGrid& detail, const std::vector<Bricks>& layer,
                FieldWriter* writer) {
  std::vector<Status> results(layer.size());
  ParallelFor(0, std::ssize(layer), 4, 0, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const auto& [key, brick] = *layer[static_cast<size_t>(i)];
      results[static_cast<size_t>(i)] =
          AddBrick(level, detail, {key[2], key[1], key[0]}, brick, writer);
    }
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return writer->EndLayer(level, layer.front()->first[0]);
}

}  // namespace

FieldWriter::FieldWriter(FileSystem& files, const std::string& store_path, const DatasetInfo& info,
                         std::string field, EncoderPool* encoders, OnEnd on_end)
    : store_path_(store_path),
      field_(std::move(field)),
      coarse_coding_(CoarseCoding(info, info.FieldOf(field_))),
      step_(info.committed_steps),
      coarse_dims_(info.hierarchy.DimsAt(0)),
      encoders_(encoders),
      batch_(files),
      on_end_(std::move(on_end)) {
  retained_ = RetainedChunks::Make(info).value_or(retained_);  // a store's info was checked
  for (int level = 0; level < info.hierarchy.finest(); ++level) {
    levels_.push_back(std::make_unique<LevelWriter>(
        store_path_, field_, step_, LevelLayout::Make(info, info.FieldOf(field_), level), encoders_,
        &batch_));
  }
}

FieldWriter::~FieldWriter() {
  if (on_end_ != nullptr) {
    on_end_(nullptr, &batch_);
  }
}

Status FieldWriter::Add(int level, const Int3& at, std::span<const std::byte> values,
                        float largest) {
  if (!retained_.Keeps(level, at)) {
    return absl::OkStatus();
  }
  return levels_[static_cast<size_t>(level)]->Add(at, values, largest);
}

Status FieldWriter::EndLayer(int level, int64_t z) {
  return levels_[static_cast<size_t>(level)]->EndLayer(z);
}

Status FieldWriter::Finish(const Grid& coarse, const FieldStats& stats) {
  const Status status = FinishFiles(coarse, stats);
  std::exchange(on_end_, nullptr)(status.ok() ? &stats : nullptr, &batch_);
  return Annotate(status, fmt::format("field '{}' of step {}", field_, step_));
}

Status FieldWriter::FinishFiles(const Grid& coarse, const FieldStats& stats) {
  if (!std::isfinite(stats.minimum) || !std::isfinite(stats.maximum) ||
      stats.minimum > stats.maximum) {
    return InvalidArgument("it has the range {} to {}", stats.minimum, stats.maximum);
  }
  FOVEA_RETURN_IF_ERROR(WriteCoarse(coarse));
  for (const auto& level : levels_) {
    FOVEA_RETURN_IF_ERROR(level->Finish());
  }
  return absl::OkStatus();
}

Status FieldWriter::WriteCoarse(const Grid& coarse) {
  if (coarse.box != Box3::OfSize(coarse_dims_) ||
      std::ssize(coarse.values) != coarse_dims_.Product()) {
    return InvalidArgument("the coarse level is not of {} x {} x {} values", coarse_dims_.x,
                           coarse_dims_.y, coarse_dims_.z);
  }
  for (const float value : coarse.values) {
    if (!std::isfinite(value)) {
      return InvalidArgument("a coarse value is not finite");
    }
  }
  // Stored even if it is all zeros: no step is without it, so that its loss is noticed.
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded,
                         encoders_->Borrow()->EncodeValues(coarse.values, coarse_coding_));
  const std::string name = SpaceChunkName(step_, {0, 0, 0}, /*with_bands=*/false);
  return batch_.Write(fmt::format("{}/{}/{}", store_path_, CoarsePath(field_), name), encoded);
}

Status CheckCoefficients(const DatasetInfo& info, const std::string& field,
                         const CoefficientSet& coefficients) {
  const Hierarchy& hierarchy = info.hierarchy;
  bool fits =
      coefficients.hierarchy == hierarchy && std::ssize(coefficients.detail) == hierarchy.finest();
  for (int level = 0; fits && level < hierarchy.finest(); ++level) {
    const BrickGrid& detail = coefficients.detail[static_cast<size_t>(level)];
    fits = detail.dims() == hierarchy.DimsAt(level) && detail.edge() == info.chunk_edge &&
           detail.channels() == kSubBands && detail.background() == 0;
  }
  if (!fits) {
    return InvalidArgument(
        "the coefficients of field '{}' are not of {} x {} x {} voxels in bricks of {}", field,
        hierarchy.dims().x, hierarchy.dims().y, hierarchy.dims().z, info.chunk_edge);
  }
  const Basis& basis = coefficients.basis;
  if (WaveletName(basis.wavelet) != info.wavelet) {
    return InvalidArgument(
        "the coefficients of field '{}' are of the wavelet {}, the store's of {}", field,
        WaveletName(basis.wavelet), info.wavelet);
  }
  if (basis.integer != BasisOf(info, info.FieldOf(field)).integer) {
    return InvalidArgument("the coefficients of field '{}' are {}, the store's {}", field,
                           basis.integer ? "integers" : "floats", info.TypeOf(field));
  }
  return absl::OkStatus();
}

Status AddAllDetail(const CoefficientSet& set, FieldWriter* writer) {
  for (int level = 0; level < std::ssize(set.detail); ++level) {
    const BrickGrid& detail = set.detail[static_cast<size_t>(level)];
    std::vector<Bricks> layer;
    for (Bricks brick = detail.bricks().begin(); brick != detail.bricks().end(); ++brick) {
      if (!layer.empty() && layer.front()->first[0] != brick->first[0]) {
        FOVEA_RETURN_IF_ERROR(AddLayer(level, detail, layer, writer));
        layer.clear();
      }
      layer.push_back(brick);
    }
    if (!layer.empty()) {
      FOVEA_RETURN_IF_ERROR(AddLayer(level, detail, layer, writer));
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
