#include "engine/fovea/value_blocks.h"

#include <algorithm>
#include <limits>

#include "engine/base/parallel.h"

namespace fovea {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Widens [low, high] by `values`, point by point. NaN widens nothing.
void Widen(const float* values, int64_t count, float* low, float* high) {
  for (int64_t i = 0; i < count; ++i) {
    low[i] = values[i] < low[i] ? values[i] : low[i];
    high[i] = values[i] > high[i] ? values[i] : high[i];
  }
}

int64_t BlocksOf(int64_t size) {
  return (size + ValueBlocks::kEdge - 1) / ValueBlocks::kEdge;
}

/// One row of blocks: first all its rows of points into one, then along that.
void FillRow(const Grid& grid, int64_t by, int64_t bz, std::vector<float>* low_row,
             std::vector<float>* high_row, ValueBlocks* blocks) {
  constexpr int64_t kEdge = ValueBlocks::kEdge;
  const Int3 size = grid.box.Size();
  std::fill(low_row->begin(), low_row->end(), kInfinity);
  std::fill(high_row->begin(), high_row->end(), -kInfinity);
  for (int64_t z = bz * kEdge; z < std::min(size.z, bz * kEdge + kEdge + 1); ++z) {
    for (int64_t y = by * kEdge; y < std::min(size.y, by * kEdge + kEdge + 1); ++y) {
      Widen(grid.values.data() + (z * size.y + y) * size.x, size.x, low_row->data(),
            high_row->data());
    }
  }
  for (int64_t bx = 0; bx < blocks->count.x; ++bx) {
    const int64_t last = std::min(size.x, bx * kEdge + kEdge + 1);
    float low = kInfinity;
    float high = -kInfinity;
    for (int64_t x = bx * kEdge; x < last; ++x) {
      low = std::min(low, (*low_row)[x]);
      high = std::max(high, (*high_row)[x]);
    }
    const size_t at = blocks->Index(bx, by, bz);
    blocks->low[at] = low;
    blocks->high[at] = high;
  }
}

}  // namespace

ValueBlocks MakeValueBlocks(const Grid& grid, int threads) {
  ValueBlocks blocks;
  const Int3 size = grid.box.Size();
  blocks.count = {BlocksOf(size.x), BlocksOf(size.y), BlocksOf(size.z)};
  blocks.low.resize(static_cast<size_t>(blocks.count.Product()));
  blocks.high.resize(blocks.low.size());
  ParallelFor(0, blocks.count.z, 1, threads, [&](int64_t first, int64_t last) {
    std::vector<float> low_row(static_cast<size_t>(size.x));
    std::vector<float> high_row(static_cast<size_t>(size.x));
    for (int64_t bz = first; bz < last; ++bz) {
      for (int64_t by = 0; by < blocks.count.y; ++by) {
        FillRow(grid, by, bz, &low_row, &high_row, &blocks);
      }
    }
  });
  return blocks;
}

}  // namespace fovea
