#include "engine/render/slice_view.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/render/slice_view.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <algorithm>

#include <hwy/highway.h>

#include "engine/base/parallel.h"

HWY_BEFORE_NAMESPACE();
namespace fovea::render::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// to[x * to_stride + y] = from[y * from_stride + x].
void Turn(const float* HWY_RESTRICT from, int64_t from_stride, int64_t count_x, int64_t count_y,
          float* HWY_RESTRICT to, int64_t to_stride) {
  int64_t done_y = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::FixedTag<float, 4> d;
  const hn::RepartitionToWide<decltype(d)> dd;
  const int64_t whole_x = count_x / 4 * 4;
  for (; done_y + 4 <= count_y; done_y += 4) {
    for (int64_t x = 0; x < whole_x; x += 4) {
      const float* at = from + done_y * from_stride + x;
      const auto a = hn::LoadU(d, at);
      const auto b = hn::LoadU(d, at + from_stride);
      const auto c = hn::LoadU(d, at + 2 * from_stride);
      const auto e = hn::LoadU(d, at + 3 * from_stride);
      const auto ab0 = hn::BitCast(dd, hn::InterleaveLower(d, a, b));  // a0 b0 a1 b1
      const auto ce0 = hn::BitCast(dd, hn::InterleaveLower(d, c, e));
      const auto ab2 = hn::BitCast(dd, hn::InterleaveUpper(d, a, b));
      const auto ce2 = hn::BitCast(dd, hn::InterleaveUpper(d, c, e));
      float* out = to + x * to_stride + done_y;
      hn::StoreU(hn::BitCast(d, hn::InterleaveLower(dd, ab0, ce0)), d, out);
      hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(dd, ab0, ce0)), d, out + to_stride);
      hn::StoreU(hn::BitCast(d, hn::InterleaveLower(dd, ab2, ce2)), d, out + 2 * to_stride);
      hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(dd, ab2, ce2)), d, out + 3 * to_stride);
    }
    for (int64_t x = whole_x; x < count_x; ++x) {
      for (int64_t y = done_y; y < done_y + 4; ++y) {
        to[x * to_stride + y] = from[y * from_stride + x];
      }
    }
  }
#endif
  for (int64_t y = done_y; y < count_y; ++y) {
    for (int64_t x = 0; x < count_x; ++x) {
      to[x * to_stride + y] = from[y * from_stride + x];
    }
  }
}

}  // namespace fovea::render::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::render {

HWY_EXPORT(Turn);

SliceView::SliceView(const Grid& grid, const ShearView& view, int threads,
                     std::vector<float>* turned, const LiveBlocks* live, int reach) {
  const Int3 size = grid.box.Size();
  const Int3& lo = grid.box.lo;
  if (view.axis_k != 0) {
    const int64_t strides[3] = {1, size.x, size.x * size.y};
    row_stride_ = strides[view.axis_v];
    slice_stride_ = strides[view.axis_k];
    base_ = grid.values.data() -
            (lo.x + lo[view.axis_v] * row_stride_ + lo[view.axis_k] * slice_stride_);
    return;
  }
  // Slices across x: u = y, v = z. Each plane across z is turned in itself, which stays in the
  // cache: [z][y][x] becomes [z][x][y].
  constexpr int64_t kEdge = ValueBlocks::kEdge;
  if (turned->size() < grid.values.size()) {
    turned->resize(grid.values.size());
  }
  row_stride_ = size.x * size.y;
  slice_stride_ = size.y;
  base_ = turned->data() - (lo.y + lo.z * row_stride_ + lo.x * slice_stride_);
  const auto turn = [&](int64_t x0, int64_t x1, int64_t y, int64_t z) {
    HWY_DYNAMIC_DISPATCH(Turn)
    (grid.values.data() + z * row_stride_ + y * size.x + x0, size.x, x1 - x0,
     std::min(kEdge, size.y - y), turned->data() + z * row_stride_ + x0 * size.y + y, size.y);
  };
  const auto is_read = [&](int64_t x, int64_t y, int64_t z) {
    return live == nullptr || live->IsRead(y / kEdge, z / kEdge, x / kEdge, reach);
  };
  ParallelFor(0, (size.z + kEdge - 1) / kEdge, 1, threads, [&](int64_t first, int64_t last) {
    for (int64_t z0 = first * kEdge; z0 < std::min(size.z, last * kEdge); z0 += kEdge) {
      for (int64_t y = 0; y < size.y; y += kEdge) {
        for (int64_t x = 0; x < size.x; x += kEdge) {
          const int64_t begin = x;
          while (x < size.x && is_read(x, y, z0)) {
            x += kEdge;
          }
          for (int64_t z = z0; begin < x && z < std::min(size.z, z0 + kEdge); ++z) {
            turn(begin, std::min(x, size.x), y, z);
          }
        }
      }
    }
  });
}

}  // namespace fovea::render
#endif  // HWY_ONCE
