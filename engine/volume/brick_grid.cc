#include "engine/volume/brick_grid.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <vector>

namespace fovea {
namespace {

/// Calls `visit(brick position, part of box inside that brick)` for every brick that meets `box`.
template <typename Visit>
void ForEachBrick(const Box3& box, int64_t edge, const Visit& visit) {
  for (int64_t bz = box.lo.z / edge; bz * edge < box.hi.z; ++bz) {
    for (int64_t by = box.lo.y / edge; by * edge < box.hi.y; ++by) {
      for (int64_t bx = box.lo.x / edge; bx * edge < box.hi.x; ++bx) {
        const Box3 cube{{bx * edge, by * edge, bz * edge},
                        {(bx + 1) * edge, (by + 1) * edge, (bz + 1) * edge}};
        visit(Int3{bx, by, bz}, Intersect(box, cube));
      }
    }
  }
}

size_t OffsetIn(int64_t edge, const Int3& brick, int64_t x, int64_t y, int64_t z) {
  return static_cast<size_t>(((z - brick.z * edge) * edge + (y - brick.y * edge)) * edge + x -
                             brick.x * edge);
}

}  // namespace

const BrickGrid::Brick* BrickGrid::Find(const Int3& position) const {
  const auto found = bricks_.find({position.z, position.y, position.x});
  return found == bricks_.end() ? nullptr : &found->second;
}

BrickGrid::Brick& BrickGrid::Touch(const Int3& position) {
  const auto [entry, is_new] = bricks_.try_emplace({position.z, position.y, position.x});
  if (is_new) {
    entry->second.assign(static_cast<size_t>(brick_values()), background_);
  }
  return entry->second;
}

void BrickGrid::CopyOut(const Box3& box, std::span<float> out) const {
  std::fill(out.begin(), out.end(), background_);
  const Box3 inside = Intersect(box, Box3::OfSize(dims_));
  if (inside.IsEmpty()) {
    return;
  }
  const Int3 size = box.Size();
  const int64_t cube = edge_ * edge_ * edge_;
  ForEachBrick(inside, edge_, [&](const Int3& at, const Box3& part) {
    const Brick* brick = Find(at);
    if (brick == nullptr) {
      return;
    }
    for (int channel = 0; channel < channels_; ++channel) {
      for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
        for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
          const float* from = brick->data() + channel * cube + OffsetIn(edge_, at, part.lo.x, y, z);
          float* to = out.data() + channel * size.Product() +
                      ((z - box.lo.z) * size.y + (y - box.lo.y)) * size.x + part.lo.x - box.lo.x;
          std::copy_n(from, part.hi.x - part.lo.x, to);
        }
      }
    }
  });
}

void BrickGrid::CopyIn(const Box3& box, std::span<const float> values) {
  const Box3 inside = Intersect(box, Box3::OfSize(dims_));
  if (inside.IsEmpty()) {
    return;
  }
  const Int3 size = box.Size();
  ForEachBrick(inside, edge_, [&](const Int3& at, const Box3& part) {
    Brick& brick = Touch(at);
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const float* from = values.data() + ((z - box.lo.z) * size.y + (y - box.lo.y)) * size.x +
                            part.lo.x - box.lo.x;
        std::copy_n(from, part.hi.x - part.lo.x,
                    brick.data() + OffsetIn(edge_, at, part.lo.x, y, z));
      }
    }
  });
}

namespace {

constexpr int kBins = 256;

/// Calls `visit` with values until it has had every stored voxel inside the grid. Returns how many
/// are not stored.
template <typename Visit>
int64_t ForEachRun(const BrickGrid& voxels, const Visit& visit) {
  const int64_t edge = voxels.edge();
  int64_t stored = 0;
  std::vector<float> inside;  // of a brick at the border
  for (const auto& [key, brick] : voxels.bricks()) {
    const Int3 at{key[2], key[1], key[0]};
    const Box3 whole{{at.x * edge, at.y * edge, at.z * edge},
                     {(at.x + 1) * edge, (at.y + 1) * edge, (at.z + 1) * edge}};
    const Box3 part = Intersect(Box3::OfSize(voxels.dims()), whole);
    stored += part.Volume();
    if (part == whole) {
      visit(std::span<const float>(brick));
      continue;
    }
    inside.resize(static_cast<size_t>(part.Volume()));
    float* to = inside.data();
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const float* const row = brick.data() + OffsetIn(edge, at, part.lo.x, y, z);
        to = std::copy(row, row + (part.hi.x - part.lo.x), to);
      }
    }
    visit(std::span<const float>(inside));
  }
  return voxels.dims().Product() - stored;
}

/// Least and greatest, in lanes of their own, so that several values are compared at once (so many
/// that the compiler makes vectors of them).
class Range {
 public:
  Range() {
    least_.fill(INFINITY);
    most_.fill(-INFINITY);
  }
  void Add(std::span<const float> values) {
    for (; values.size() >= kLanes; values = values.subspan(kLanes)) {
      Compare(values.data(), kLanes);
    }
    Compare(values.data(), values.size());
  }
  [[nodiscard]] float Least() const { return *std::min_element(least_.begin(), least_.end()); }
  [[nodiscard]] float Most() const { return *std::max_element(most_.begin(), most_.end()); }

 private:
  static constexpr size_t kLanes = 64;

  /// Of NaN, which is neither, nothing is noted.
  void Compare(const float* values, size_t count) {
    for (size_t lane = 0; lane < count; ++lane) {
      const float value = values[lane], least = least_[lane], most = most_[lane];
      least_[lane] = value < least ? value : least;
      most_[lane] = value > most ? value : most;
    }
  }

  std::array<float, kLanes> least_, most_;
};

/// Whether all values are the same bits.
bool IsOneValue(std::span<const float> values) {
  const auto first = std::bit_cast<uint32_t>(values[0]);
  uint32_t difference = 0;
  for (const float value : values) {
    difference |= std::bit_cast<uint32_t>(value) ^ first;
  }
  return difference == 0;
}

/// Counts values in bins. Neighbours are often of one bin: they are counted in tables of their own,
/// so that no count waits for the one before.
class BinCounter {
 public:
  BinCounter(double minimum, double scale) : minimum_(minimum), scale_(scale) {}
  void Add(std::span<const float> values) {
    for (; values.size() >= kStrip; values = values.subspan(kStrip)) {
      AddStrip(values.first<kStrip>());
    }
    for (const float value : values) {
      ++tables_[0][static_cast<size_t>(BinOf(value))];
    }
  }
  void AddTo(std::array<uint64_t, kBins>* histogram) const {
    for (const auto& table : tables_) {
      for (size_t bin = 0; bin < kBins; ++bin) {
        (*histogram)[bin] += table[bin];
      }
    }
  }
  /// NaN, which has none, is counted in the first.
  [[nodiscard]] int32_t BinOf(float value) const {
    const double at = (value - minimum_) * scale_;
    const double low = at > 0.0 ? at : 0.0;
    return static_cast<int32_t>(low < kBins - 1.0 ? low : kBins - 1.0);
  }

 private:
  static constexpr size_t kStrip = 32;
  void AddStrip(std::span<const float, kStrip> strip) {
    if (IsOneValue(strip)) {  // as in most of what surrounds things
      tables_[0][static_cast<size_t>(BinOf(strip[0]))] += strip.size();
      return;
    }
    std::array<int32_t, kStrip> bins;
    for (size_t k = 0; k < kStrip; ++k) {
      bins[k] = BinOf(strip[k]);
    }
    for (size_t k = 0; k < kStrip; ++k) {
      ++tables_[k % kTables][static_cast<size_t>(bins[k])];
    }
  }

  static constexpr size_t kTables = 4;
  double minimum_, scale_;
  std::array<std::array<uint64_t, kBins>, kTables> tables_{};
};

}  // namespace

FieldStats ComputeStats(const BrickGrid& voxels) {
  Range range;
  const float background = voxels.background();
  const int64_t absent =
      ForEachRun(voxels, [&](std::span<const float> values) { range.Add(values); });
  if (absent > 0) {
    range.Add(std::span(&background, 1));
  }
  FieldStats stats;
  stats.minimum = range.Least();
  stats.maximum = range.Most();
  const bool is_one_value = !(stats.maximum > stats.minimum);
  BinCounter counter(stats.minimum, is_one_value ? 0.0 : kBins / (stats.maximum - stats.minimum));
  ForEachRun(voxels, [&](std::span<const float> values) { counter.Add(values); });
  counter.AddTo(&stats.histogram);
  if (absent > 0) {
    stats.histogram[static_cast<size_t>(counter.BinOf(background))] +=
        static_cast<uint64_t>(absent);
  }
  return stats;
}

}  // namespace fovea
