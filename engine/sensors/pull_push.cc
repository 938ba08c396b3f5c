#include "engine/sensors/pull_push.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>
#include <vector>

#include "engine/sensors/morton.h"

// One pass up the levels over the sorted cells: the children of a cell stand side by side, and so
// do the cells of a brick. Each cell's children, those without readings filled in, are transformed
// a batch of cells at a time, with the sums in the order of wavelet::Forward: the bits are the
// same. Children that are all filled with one value have zeros below them, so nothing is ever done
// for them.

namespace fovea::sensors {
namespace {

constexpr int kChildren = 8;

/// Cells of one level that hold readings, by ascending key.
struct Cells {
  std::vector<uint64_t> keys;
  std::vector<float> values;
};

/// Values of a batch of cells, of each child or sub-band: bit 0 of the index is x, bit 1 y, bit 2
/// z.
constexpr size_t kBatch = 512;
using Batch = std::array<std::array<float, kBatch>, kChildren>;

/// The Haar transform of each of `count` cells.
void TransformCells(const Batch& child, size_t count, Batch* bands) {
  for (size_t i = 0; i < count; ++i) {
    float low[4], high[4];
    for (int row = 0; row < 4; ++row) {
      low[row] = child[2 * row][i] + child[2 * row + 1][i];
      high[row] = child[2 * row][i] - child[2 * row + 1][i];
    }
    for (int x = 0; x < 2; ++x) {
      const float* const v = x == 0 ? low : high;
      const float a0 = v[0] + v[1], y0 = v[0] - v[1];
      const float a1 = v[2] + v[3], y1 = v[2] - v[3];
      (*bands)[x][i] = (a0 + a1) * 0.125F;
      (*bands)[x + 2][i] = (y0 + y1) * 0.125F;
      (*bands)[x + 4][i] = (a0 - a1) * 0.125F;
      (*bands)[x + 6][i] = (y0 - y1) * 0.125F;
    }
  }
}

/// What children without readings get.
class Filler {
 public:
  Filler(const FillRule& rule, bool coverage, float low, float high)
      : rule_(rule), coverage_(coverage), low_(low), high_(high) {}

  /// Of a cell `width` voxels wide whose children with readings sum up to `sum`.
  [[nodiscard]] float Value(double sum, int count, int64_t width) const {
    if (width > rule_.reach_voxels) {
      return coverage_ ? 0.0F : rule_.background;
    }
    return coverage_ ? 1.0F / static_cast<float>(width)
                     : std::clamp(static_cast<float>(sum / count), low_, high_);
  }

 private:
  const FillRule& rule_;
  bool coverage_;
  float low_, high_;  // of the voxels with readings: rounding must not leave their range
};

/// Counts voxels by value, in the bins of FieldStats.
class Counter {
 public:
  Counter(float low, float high) {
    stats_.minimum = low;
    stats_.maximum = high;
    scale_ = high > low ? 256.0 / (stats_.maximum - stats_.minimum) : 0.0;
  }
  void Add(float value, int64_t voxels) {
    const auto bin = static_cast<size_t>((value - stats_.minimum) * scale_);
    stats_.histogram[std::min<size_t>(bin, 255)] += static_cast<uint64_t>(voxels);
  }
  [[nodiscard]] const FieldStats& stats() const { return stats_; }

 private:
  FieldStats stats_;
  double scale_ = 0;
};

/// The voxels of the cell at `at`, `width` wide, that lie inside `dims`.
int64_t VoxelsOf(const Int3& at, int64_t width, const Int3& dims) {
  int64_t product = 1;
  for (int axis = 0; axis < 3; ++axis) {
    product *= std::clamp<int64_t>(dims[axis] - at[axis] * width, 0, width);
  }
  return product;
}

/// One level: cells of level l+1 become cells of level l and detail.
class LevelPull {
 public:
  LevelPull(const Hierarchy& hierarchy, int level, const Filler& filler, Counter* counter,
            Cells* cells, BrickGrid* detail)
      : dims_(hierarchy.dims()),
        child_dims_(hierarchy.DimsAt(level + 1)),
        width_(hierarchy.WidthAt(level)),
        brick_bits_(std::countr_zero(static_cast<uint64_t>(detail->edge()))),
        filler_(filler),
        counter_(*counter),
        cells_(*cells),
        detail_(*detail) {}

  /// Returns the number of cells that were made.
  int64_t Run() {
    const size_t count = cells_.keys.size();
    size_t made = 0;
    for (size_t i = 0; i < count;) {
      const uint64_t parent = cells_.keys[i] >> 3;
      if ((parent >> (3 * brick_bits_)) != brick_key_ || batch_ == kBatch || i == 0) {
        Flush();
        EnterBrick(parent >> (3 * brick_bits_));
      }
      i = Gather(i, parent);
      batch_keys_[batch_] = parent;
      batch_to_[batch_++] = made;
      cells_.keys[made++] = parent;  // never past what was read
    }
    Flush();
    cells_.keys.resize(made);
    cells_.values.resize(made);
    return static_cast<int64_t>(made);
  }

 private:
  void EnterBrick(uint64_t key) {
    brick_key_ = key;
    brick_at_ = MortonPosition(key);
    const int64_t edge = detail_.edge();
    brick_ = nullptr;
    inside_ = true;
    for (int axis = 0; axis < 3; ++axis) {
      inside_ = inside_ && (brick_at_[axis] + 1) * edge * width_ <= dims_[axis];
    }
  }

  /// The children of `parent`, from cell `i` on, into the batch; returns the cell behind them.
  size_t Gather(size_t i, uint64_t parent) {
    std::array<float, kChildren> child;
    unsigned has = 0;
    double sum = 0;
    for (; i < cells_.keys.size() && cells_.keys[i] >> 3 == parent; ++i) {
      const auto at = static_cast<unsigned>(cells_.keys[i] & 7);
      child[at] = cells_.values[i];
      has |= 1U << at;
      sum += cells_.values[i];
    }
    if (has != 0xff) {
      const float fill = filler_.Value(sum, std::popcount(has), width_);
      for (unsigned at = 0; at < kChildren; ++at) {
        child[at] = (has >> at & 1) != 0 ? child[at] : fill;
      }
      if (inside_) {
        const int64_t half = width_ / 2;
        counter_.Add(fill, (kChildren - std::popcount(has)) * half * half * half);
      } else {
        MendBorder(MortonPosition(parent), has, fill, &child);
      }
    }
    for (unsigned at = 0; at < kChildren; ++at) {
      child_[at][batch_] = child[at];
    }
    return i;
  }

  /// An odd last child pairs with itself. Counts the voxels that `fill` goes to.
  void MendBorder(const Int3& parent, unsigned has, float fill,
                  std::array<float, kChildren>* child) {
    unsigned there = 0xff;
    constexpr std::array<unsigned, 3> kLower = {0x55, 0x33, 0x0f};  // even on that axis
    for (int axis = 0; axis < 3; ++axis) {
      if (2 * parent[axis] + 1 >= child_dims_[axis]) {
        there &= kLower[axis];
        for (unsigned at = 0; at < kChildren; ++at) {
          (*child)[at] = (*child)[at & ~(1U << axis)];
        }
      }
    }
    for (unsigned at = 0; at < kChildren; ++at) {
      if ((there & ~has) >> at & 1) {
        const Int3 position{2 * parent.x + (at & 1), 2 * parent.y + (at >> 1 & 1),
                            2 * parent.z + (at >> 2)};
        counter_.Add(fill, VoxelsOf(position, width_ / 2, dims_));
      }
    }
  }

  /// Transforms the batch, keeps the means for the next level, and puts detail in its brick.
  void Flush() {
    if (batch_ == 0) {
      return;
    }
    TransformCells(child_, batch_, &bands_);
    const int64_t edge = detail_.edge();
    for (size_t i = 0; i < batch_; ++i) {
      cells_.values[batch_to_[i]] = bands_[0][i];
      bool any = false;
      for (int band = 1; band < kChildren; ++band) {
        any = any || bands_[band][i] != 0;
      }
      if (!any) {
        continue;
      }
      if (brick_ == nullptr) {
        brick_ = detail_.Touch(brick_at_).data();
      }
      const Int3 at = MortonPosition(batch_keys_[i] & ((uint64_t{1} << (3 * brick_bits_)) - 1));
      float* value = brick_ + (at.z * edge + at.y) * edge + at.x;
      for (int band = 1; band < kChildren; ++band, value += edge * edge * edge) {
        *value = bands_[band][i];
      }
    }
    batch_ = 0;
  }

  const Int3 dims_, child_dims_;
  const int64_t width_;  // of the cells that are made
  const int brick_bits_;
  const Filler& filler_;
  Counter& counter_;
  Cells& cells_;
  BrickGrid& detail_;
  uint64_t brick_key_ = 0;
  Int3 brick_at_;
  float* brick_ = nullptr;  // null until there is detail that is not zero
  bool inside_ = false;     // the brick overhangs the volume nowhere
  // Cells on their way through the transform; all of one brick.
  size_t batch_ = 0;
  std::array<uint64_t, kBatch> batch_keys_;
  std::array<size_t, kBatch> batch_to_;
  Batch child_, bands_;
};

/// The coarsest level whole: what has no readings takes the mean of the cells above that do.
Grid FillCoarse(const Hierarchy& hierarchy, const Cells& cells, const Filler& filler,
                Counter* counter) {
  const Int3 dims = hierarchy.DimsAt(0);
  std::vector<Cells> above = {cells};
  for (uint64_t last_key = MortonKey({dims.x - 1, dims.y - 1, dims.z - 1}); last_key != 0;
       last_key >>= 3) {
    Cells next;
    const Cells& last = above.back();
    for (size_t i = 0; i < last.keys.size();) {
      const uint64_t parent = last.keys[i] >> 3;
      double sum = 0;
      int count = 0;
      for (; i < last.keys.size() && last.keys[i] >> 3 == parent; ++i, ++count) {
        sum += last.values[i];
      }
      next.keys.push_back(parent);
      next.values.push_back(
          filler.Value(sum, count, hierarchy.WidthAt(0) << static_cast<int>(above.size())));
    }
    above.push_back(std::move(next));
  }
  Grid coarse(Box3::OfSize(dims));
  for (int64_t z = 0; z < dims.z; ++z) {
    for (int64_t y = 0; y < dims.y; ++y) {
      for (int64_t x = 0; x < dims.x; ++x) {
        float value = 0;
        uint64_t key = MortonKey({x, y, z});
        for (size_t up = 0; up < above.size(); ++up, key >>= 3) {
          const auto& keys = above[up].keys;
          const auto found = std::lower_bound(keys.begin(), keys.end(), key);
          if (found != keys.end() && *found == key) {
            value = above[up].values[static_cast<size_t>(found - keys.begin())];
            if (up > 0) {
              counter->Add(value, VoxelsOf({x, y, z}, hierarchy.WidthAt(0), hierarchy.dims()));
            }
            break;
          }
        }
        coarse.At(x, y, z) = value;
      }
    }
  }
  return coarse;
}

/// Whether some voxel has no readings within reach.
bool IsAnyOutOfReach(const Hierarchy& hierarchy, std::span<const uint64_t> keys, int64_t reach) {
  int up = 0;
  while (up < 17 && (int64_t{2} << up) <= reach) {
    ++up;
  }
  const int64_t width = int64_t{1} << up;
  int64_t cells = 0;
  uint64_t last = ~uint64_t{0};
  for (const uint64_t key : keys) {
    cells += (key >> (3 * up)) != last ? 1 : 0;
    last = key >> (3 * up);
  }
  int64_t all = 1;
  for (int axis = 0; axis < 3; ++axis) {
    all *= (hierarchy.dims()[axis] + width - 1) / width;
  }
  return cells < all;
}

/// The coverage of the voxel that has least of it.
float LeastCoverage(const Hierarchy& hierarchy, std::span<const uint64_t> keys,
                    const FillRule& rule) {
  for (int up = 0; up <= 17; ++up) {
    const int64_t width = int64_t{1} << up;
    if (width > rule.reach_voxels) {
      return 0;
    }
    if (!IsAnyOutOfReach(hierarchy, keys, width)) {
      return 1.0F / static_cast<float>(width);
    }
  }
  return 0;
}

FilledField Fill(const Hierarchy& hierarchy, int64_t brick_edge, Cells cells, const Filler& filler,
                 Counter counter) {
  FilledField field;
  CoefficientSet& set = field.coefficients;
  set.hierarchy = hierarchy;
  set.detail.resize(static_cast<size_t>(hierarchy.finest()));
  for (const float value : cells.values) {
    counter.Add(value, 1);
  }
  for (int level = hierarchy.finest() - 1; level >= 0; --level) {
    BrickGrid& detail = set.detail[static_cast<size_t>(level)];
    detail = BrickGrid(hierarchy.DimsAt(level), brick_edge, 7, 0.0F);
    field.cells += LevelPull(hierarchy, level, filler, &counter, &cells, &detail).Run();
  }
  set.coarse = FillCoarse(hierarchy, cells, filler, &counter);
  field.stats = counter.stats();
  return field;
}

}  // namespace

FilledField FillField(const Hierarchy& hierarchy, int64_t brick_edge,
                      std::span<const uint64_t> keys, std::span<const float> values,
                      const FillRule& rule) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const Filler filler(rule, /*coverage=*/false, *low, *high);
  const bool background = IsAnyOutOfReach(hierarchy, keys, rule.reach_voxels);
  const Counter counter(background ? std::min(*low, rule.background) : *low,
                        background ? std::max(*high, rule.background) : *high);
  return Fill(hierarchy, brick_edge, {{keys.begin(), keys.end()}, {values.begin(), values.end()}},
              filler, counter);
}

FilledField FillCoverage(const Hierarchy& hierarchy, int64_t brick_edge,
                         std::span<const uint64_t> keys, const FillRule& rule) {
  const Filler filler(rule, /*coverage=*/true, 1, 1);
  const Counter counter(LeastCoverage(hierarchy, keys, rule), 1);
  return Fill(hierarchy, brick_edge,
              {{keys.begin(), keys.end()}, std::vector<float>(keys.size(), 1.0F)}, filler, counter);
}

int64_t CountBricks(const Hierarchy& hierarchy, int64_t brick_edge,
                    std::span<const uint64_t> keys) {
  const int bits = std::countr_zero(static_cast<uint64_t>(brick_edge));
  int64_t bricks = 0;
  for (int level = 0; level < hierarchy.finest(); ++level) {
    const int shift = 3 * (hierarchy.finest() - level + bits);
    uint64_t last = ~uint64_t{0};
    for (const uint64_t key : keys) {
      bricks += (key >> shift) != last ? 1 : 0;
      last = key >> shift;
    }
  }
  return bricks;
}

}  // namespace fovea::sensors
