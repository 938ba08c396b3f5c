#include "engine/volume/brick_grid.h"

#include <algorithm>
#include <cmath>

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

/// Calls `visit(value, count)` for every voxel inside the grid; background comes as one call.
template <typename Visit>
void ForEachValue(const BrickGrid& voxels, const Visit& visit) {
  const int64_t edge = voxels.edge();
  int64_t stored = 0;
  for (const auto& [key, brick] : voxels.bricks()) {
    const Int3 at{key[2], key[1], key[0]};
    const Box3 part = Intersect(Box3::OfSize(voxels.dims()),
                                {{at.x * edge, at.y * edge, at.z * edge},
                                 {(at.x + 1) * edge, (at.y + 1) * edge, (at.z + 1) * edge}});
    stored += part.Volume();
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const float* row = brick.data() + OffsetIn(edge, at, part.lo.x, y, z);
        for (int64_t i = 0; i < part.hi.x - part.lo.x; ++i) {
          visit(row[i], int64_t{1});
        }
      }
    }
  }
  const int64_t rest = voxels.dims().Product() - stored;
  if (rest > 0) {
    visit(voxels.background(), rest);
  }
}

}  // namespace

FieldStats ComputeStats(const BrickGrid& voxels) {
  float least = INFINITY;
  float most = -INFINITY;
  ForEachValue(voxels, [&](float value, int64_t) {
    least = std::min(least, value);
    most = std::max(most, value);
  });
  FieldStats stats;
  stats.minimum = least;
  stats.maximum = most;
  const double scale = most > least ? 256.0 / (stats.maximum - stats.minimum) : 0.0;
  ForEachValue(voxels, [&](float value, int64_t count) {
    const auto bin = static_cast<size_t>((value - stats.minimum) * scale);
    stats.histogram[std::min<size_t>(bin, 255)] += static_cast<uint64_t>(count);
  });
  return stats;
}

}  // namespace fovea
