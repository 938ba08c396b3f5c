#include "service/coefficients/held_step.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/store/layout.h"
#include "engine/store/stored_type.h"

namespace fovea::coefficients {
namespace {

constexpr int64_t kBrickEdge = 16;

bool AreZero(const float* values, int64_t count) {
  return std::all_of(values, values + count, [](float v) { return v == 0; });
}

/// Calls body(row in the box, row in the brick, length) for each row of each channel in `part`,
/// which lies in one brick.
template <typename Body>
void ForRows(const Box3& box, const Box3& part, const Int3& brick, const Body& body) {
  const Int3 size = box.Size();
  for (int64_t channel = 0; channel < store::kSubBands; ++channel) {
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const int64_t in_box =
            ((channel * size.z + z - box.lo.z) * size.y + y - box.lo.y) * size.x + part.lo.x -
            box.lo.x;
        const int64_t in_brick = ((channel * kBrickEdge + z - brick.z * kBrickEdge) * kBrickEdge +
                                  y - brick.y * kBrickEdge) *
                                     kBrickEdge +
                                 part.lo.x - brick.x * kBrickEdge;
        body(in_box, in_brick, part.hi.x - part.lo.x);
      }
    }
  }
}

Box3 BrickBox(const Int3& brick) {
  return {{brick.x * kBrickEdge, brick.y * kBrickEdge, brick.z * kBrickEdge},
          {(brick.x + 1) * kBrickEdge, (brick.y + 1) * kBrickEdge, (brick.z + 1) * kBrickEdge}};
}

/// Writes [7][z][y][x] over `box`. Bricks of zeros are not made.
void WriteDetail(const Box3& box, std::span<const float> values, BrickGrid* grid) {
  for (int64_t z = box.lo.z / kBrickEdge; z * kBrickEdge < box.hi.z; ++z) {
    for (int64_t y = box.lo.y / kBrickEdge; y * kBrickEdge < box.hi.y; ++y) {
      for (int64_t x = box.lo.x / kBrickEdge; x * kBrickEdge < box.hi.x; ++x) {
        const Int3 brick{x, y, z};
        const Box3 part = Intersect(BrickBox(brick), box);
        if (grid->Find(brick) == nullptr) {
          bool zero = true;
          ForRows(box, part, brick, [&](int64_t from, int64_t, int64_t count) {
            zero = zero && AreZero(values.data() + from, count);
          });
          if (zero) {
            continue;
          }
        }
        BrickGrid::Brick& into = grid->Touch(brick);
        ForRows(box, part, brick, [&](int64_t from, int64_t to, int64_t count) {
          std::copy_n(values.data() + from, count, into.data() + to);
        });
      }
    }
  }
}

void WriteCoarse(const Box3& box, std::span<const float> values, Grid* grid) {
  const float* row = values.data();
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      std::copy_n(row, box.hi.x - box.lo.x, grid->Row(y, z) + box.lo.x);
      row += box.hi.x - box.lo.x;
    }
  }
}

void ReadCoarse(const Grid& grid, const Box3& box, std::span<float> values) {
  float* row = values.data();
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      std::copy_n(grid.Row(y, z) + box.lo.x, box.hi.x - box.lo.x, row);
      row += box.hi.x - box.lo.x;
    }
  }
}

bool Contains(const RetainedSet& outer, const RetainedSet& inner) {
  for (int level = 0; level < inner.hierarchy().finest(); ++level) {
    if (!outer.window(level).Contains(inner.window(level))) {
      return false;
    }
  }
  return true;
}

}  // namespace

HeldStep::HeldStep(const Hierarchy& hierarchy, int64_t step, std::vector<Field> fields)
    : hierarchy_(hierarchy), step_(step), fields_(std::move(fields)) {
  for (const Field& field : fields_) {
    CoefficientSet& set = sets_.emplace_back();
    set.hierarchy = hierarchy;
    set.basis = field.basis;
    set.coarse = Grid(Box3::OfSize(hierarchy.DimsAt(0)));
    for (int level = 0; level < hierarchy.finest(); ++level) {
      set.detail.emplace_back(hierarchy.DimsAt(level), kBrickEdge, store::kSubBands, 0.0F);
    }
  }
}

StatusOr<std::vector<std::byte>> HeldStep::NumbersOf(const BlockHeader& header) const {
  const auto bytes_of_one = static_cast<size_t>(store::BytesOfType(header.type));
  std::vector<std::byte> numbers(static_cast<size_t>(header.Values()) * bytes_of_one);
  std::vector<float> values;
  size_t at = 0;
  const CoefficientSet& set = sets_[static_cast<size_t>(header.field)];
  for (const BlockBox& box : header.boxes) {
    values.resize(static_cast<size_t>(box.Values()));
    if (box.level == kCoarse) {
      ReadCoarse(set.coarse, box.box, values);
    } else {
      set.detail[static_cast<size_t>(box.level)].CopyOut(box.box, values);
    }
    const size_t bytes = values.size() * bytes_of_one;
    if (box.difference) {
      FOVEA_RETURN_IF_ERROR(
          store::ToStored(values, {header.type, box.scale}, std::span(numbers).subspan(at, bytes)));
    }
    at += bytes;
  }
  return numbers;
}

StatusOr<int64_t> HeldStep::Add(std::string_view block, const HeldStep* base) {
  FOVEA_ASSIGN_OR_RETURN(const ReceivedBlock received, ParseBlock(block, hierarchy_));
  const BlockHeader& header = received.header;
  if (header.step != static_cast<uint64_t>(step_) ||
      static_cast<size_t>(header.field) >= fields_.size()) {
    return DataLoss("a block of step {}, field {}, in a stream of step {} and {} fields",
                    header.step, header.field, step_, fields_.size());
  }
  std::vector<std::byte> base_numbers;
  if (header.HasDifferences()) {
    if (base == nullptr || static_cast<uint64_t>(base->step()) != header.base_step ||
        base->fields().size() != fields_.size()) {
      return FailedPrecondition("differences from step {}, which is not held", header.base_step);
    }
    auto numbers = base->NumbersOf(header);
    if (!numbers.ok()) {
      return FailedPrecondition("differences of another type than what is held of step {}: {}",
                                header.base_step, MessageOf(numbers.status()));
    }
    base_numbers = *std::move(numbers);
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> numbers,
                         DecodeNumbers(received, base_numbers));
  std::vector<float> values(static_cast<size_t>(header.Values()));
  size_t at = 0;
  for (const BlockBox& box : header.boxes) {
    const auto count = static_cast<size_t>(box.Values());
    const auto bytes = static_cast<size_t>(store::BytesOfType(header.type));
    store::FromStored(std::span(numbers).subspan(at * bytes, count * bytes),
                      {header.type, box.scale}, std::span(values).subspan(at, count));
    at += count;
  }
  if (!std::isfinite(store::LargestMagnitude(values))) {
    return DataLoss("a coefficient is too large for its scale");
  }
  at = 0;
  CoefficientSet& set = sets_[static_cast<size_t>(header.field)];
  for (const BlockBox& box : header.boxes) {
    const auto part = std::span<const float>(values).subspan(at, static_cast<size_t>(box.Values()));
    if (box.level == kCoarse) {
      WriteCoarse(box.box, part, &set.coarse);
    } else {
      WriteDetail(box.box, part, &set.detail[static_cast<size_t>(box.level)]);
    }
    at += part.size();
  }
  return header.Values();
}

void HeldStep::Complete(const Fovea& fovea) {
  const auto now = RetainedSet::Make(hierarchy_, fovea);
  if (!now.ok()) {
    return;
  }
  std::erase_if(regions_, [&](const Fovea& region) {
    const auto set = RetainedSet::Make(hierarchy_, region);
    return !set.ok() || Contains(*now, *set);
  });
  regions_.push_back({fovea.at, fovea.rate, WindowShape::kCube});
  if (regions_.size() > kMaxRegions) {
    regions_.erase(regions_.begin());
    Forget();
  }
}

bool HeldStep::Holds(const Fovea& fovea) const {
  const auto wanted = RetainedSet::Make(hierarchy_, fovea);
  return wanted.ok() && std::any_of(regions_.begin(), regions_.end(), [&](const Fovea& region) {
           const auto set = RetainedSet::Make(hierarchy_, region);
           return set.ok() && Contains(*set, *wanted);
         });
}

/// Drops the bricks that no window of a region meets.
void HeldStep::Forget() {
  std::vector<RetainedSet> kept;
  for (const Fovea& region : regions_) {
    if (auto set = RetainedSet::Make(hierarchy_, region); set.ok()) {
      kept.push_back(*std::move(set));
    }
  }
  for (CoefficientSet& set : sets_) {
    for (int level = 0; level < hierarchy_.finest(); ++level) {
      BrickGrid& grid = set.detail[static_cast<size_t>(level)];
      std::vector<Int3> dropped;
      for (const auto& [at, brick] : grid.bricks()) {
        const Int3 position{at[2], at[1], at[0]};
        const Box3 box = BrickBox(position);
        if (std::none_of(kept.begin(), kept.end(), [&](const RetainedSet& region) {
              return !Intersect(region.window(level), box).IsEmpty();
            })) {
          dropped.push_back(position);
        }
      }
      for (const Int3& position : dropped) {
        grid.Erase(position);
      }
    }
  }
}

}  // namespace fovea::coefficients
