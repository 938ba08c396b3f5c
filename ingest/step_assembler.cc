#include "ingest/step_assembler.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "engine/volume/hierarchy.h"

namespace fovea::ingest {
namespace {

Box3 BrickBox(const Int3& at, int64_t edge) {
  return {{at.x * edge, at.y * edge, at.z * edge},
          {(at.x + 1) * edge, (at.y + 1) * edge, (at.z + 1) * edge}};
}

/// A box of values, x fastest; no values: one constant everywhere.
struct Source {
  Box3 box;
  const char* values = nullptr;  // bytes of floats, anywhere
  float constant = 0;

  [[nodiscard]] const char* Row(int64_t x, int64_t y, int64_t z) const {
    const Int3 size = box.Size();
    return values + (((z - box.lo.z) * size.y + (y - box.lo.y)) * size.x + (x - box.lo.x)) * kBytes;
  }
  [[nodiscard]] bool IsAll(float value, const Box3& part) const {
    if (values == nullptr) {
      return constant == value;
    }
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const char* row = Row(part.lo.x, y, z);
        for (int64_t i = 0; i < part.hi.x - part.lo.x; ++i) {
          float other;
          std::memcpy(&other, row + i * kBytes, kBytes);
          if (!(other == value)) {
            return false;
          }
        }
      }
    }
    return true;
  }
  /// Copies `part` into a brick whose first voxel is `origin`; what is not finite becomes
  /// `background`. Returns how many that were.
  uint64_t CopyTo(const Box3& part, const Int3& origin, int64_t edge, float background,
                  float* brick) const {
    const int64_t count = part.hi.x - part.lo.x;
    uint64_t nonfinite = 0;
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        float* to = brick + ((z - origin.z) * edge + (y - origin.y)) * edge + part.lo.x - origin.x;
        if (values == nullptr) {
          std::fill_n(to, count, constant);
          continue;
        }
        std::memcpy(to, Row(part.lo.x, y, z), static_cast<size_t>(count * kBytes));
        for (int64_t i = 0; i < count; ++i) {
          const bool is_finite = std::isfinite(to[i]);
          nonfinite += is_finite ? 0 : 1;
          to[i] = is_finite ? to[i] : background;
        }
      }
    }
    return nonfinite;
  }

  static constexpr int64_t kBytes = sizeof(float);
};

}  // namespace

Status StepAssembler::Consume(const FrameView& reply) {
  switch (reply.kind) {
    case FrameKind::kField: {
      FOVEA_ASSIGN_OR_RETURN(const FieldStart start, DecodeFieldStart(reply));
      return Start(start);
    }
    case FrameKind::kBlock: {
      FOVEA_ASSIGN_OR_RETURN(const Block block, DecodeBlock(reply));
      return AddBlock(block);
    }
    case FrameKind::kTile: {
      FOVEA_ASSIGN_OR_RETURN(const Tile tile, DecodeTile(reply));
      return AddTile(tile);
    }
    case FrameKind::kFieldEnd: {
      FOVEA_ASSIGN_OR_RETURN(const FieldEnd end, DecodeFieldEnd(reply));
      if (!in_field_) {
        return Internal("malformed message: the end of a field that did not begin");
      }
      in_field_ = false;
      fields_.back().active = end.active;
      fields_.back().rounded = end.rounded;
      return absl::OkStatus();
    }
    default:
      return Internal("malformed message: kind {}", static_cast<uint32_t>(reply.kind));
  }
}

StatusOr<std::vector<FieldVoxels>> StepAssembler::Finish() {
  if (in_field_ || fields_.size() != expected_) {
    return Internal("malformed message: {} of {} fields came", fields_.size(), expected_);
  }
  return std::move(fields_);
}

Status StepAssembler::Start(const FieldStart& start) {
  if (in_field_ || fields_.size() >= expected_ || start.index != fields_.size()) {
    return Internal("malformed message: field {} out of turn", start.index);
  }
  in_field_ = true;
  background_ = start.background;
  fields_.push_back({BrickGrid(extent_.Size(), edge_, 1, start.fill), {}, 0, 0});
  return absl::OkStatus();
}

Status StepAssembler::AddBlock(const Block& block) {
  FOVEA_ASSIGN_OR_RETURN(const Box3 box, Inside(block.box));
  return Write(box, block.values.data(), 0);
}

Status StepAssembler::AddTile(const Tile& tile) {
  FOVEA_ASSIGN_OR_RETURN(const Box3 box, Inside(tile.box));
  if (std::isfinite(tile.value)) {
    return Write(box, nullptr, tile.value);
  }
  fields_.back().nonfinite += static_cast<uint64_t>(box.Volume());
  return Write(box, nullptr, background_);
}

StatusOr<Box3> StepAssembler::Inside(const Box3& box) const {
  if (!in_field_ || !extent_.Contains(box)) {
    return Internal("malformed message: voxels outside the extent, or of no field");
  }
  const Int3& origin = extent_.lo;
  return Box3{{box.lo.x - origin.x, box.lo.y - origin.y, box.lo.z - origin.z},
              {box.hi.x - origin.x, box.hi.y - origin.y, box.hi.z - origin.z}};
}

Status StepAssembler::TakeBytes(int64_t bricks) {
  const int64_t bytes = bricks * fields_.back().voxels.brick_values() * int64_t{sizeof(float)};
  if (bytes > bytes_left_) {
    return ResourceExhausted(
        "one time step needs more memory than a quarter of this machine's; take fewer grids at a "
        "time, or a smaller volume");
  }
  bytes_left_ -= bytes;
  return absl::OkStatus();
}

Status StepAssembler::FillWithBackground(const Box3& box) {
  BrickGrid& voxels = fields_.back().voxels;
  for (const auto& [position, brick] : voxels.bricks()) {
    const Int3 at{position[2], position[1], position[0]};
    const Box3 whole = BrickBox(at, edge_);
    const Source source{box, nullptr, voxels.background()};
    source.CopyTo(Intersect(box, whole), whole.lo, edge_, 0, voxels.Touch(at).data());
  }
  return absl::OkStatus();
}

Status StepAssembler::Write(const Box3& box, const char* values, float constant) {
  const Source source{box, values, constant};
  BrickGrid& voxels = fields_.back().voxels;
  const Box3 bricks{
      {box.lo.x / edge_, box.lo.y / edge_, box.lo.z / edge_},
      {(box.hi.x - 1) / edge_ + 1, (box.hi.y - 1) / edge_ + 1, (box.hi.z - 1) / edge_ + 1}};
  if (values == nullptr) {
    if (constant == voxels.background()) {
      return FillWithBackground(box);
    }
    // Known too large before the first brick is made: a tile may be of any size.
    const int64_t fewest = bricks.Volume() - static_cast<int64_t>(voxels.bricks().size());
    if (fewest > bytes_left_ / (voxels.brick_values() * int64_t{sizeof(float)})) {
      return TakeBytes(fewest);
    }
  }
  Int3 at;
  for (at.z = bricks.lo.z; at.z < bricks.hi.z; ++at.z) {
    for (at.y = bricks.lo.y; at.y < bricks.hi.y; ++at.y) {
      for (at.x = bricks.lo.x; at.x < bricks.hi.x; ++at.x) {
        const Box3 whole = BrickBox(at, edge_);
        const Box3 part = Intersect(box, whole);
        if (voxels.Find(at) == nullptr) {
          if (source.IsAll(voxels.background(), part)) {
            continue;
          }
          FOVEA_RETURN_IF_ERROR(TakeBytes(1));
        }
        fields_.back().nonfinite +=
            source.CopyTo(part, whole.lo, edge_, background_, voxels.Touch(at).data());
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
