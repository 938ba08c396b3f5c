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
  // Slices across x: u = y, v = z. Turned to [x][z][y], block by block.
  constexpr int64_t kEdge = ValueBlocks::kEdge;
  if (turned->size() < grid.values.size()) {
    turned->resize(grid.values.size());
  }
  row_stride_ = size.y;
  slice_stride_ = size.y * size.z;
  base_ = turned->data() - (lo.y + lo.z * row_stride_ + lo.x * slice_stride_);
  const auto blocks = [](int64_t points) { return (points + kEdge - 1) / kEdge; };
  ParallelFor(0, blocks(size.z), 1, threads, [&](int64_t first, int64_t last) {
    for (int64_t bz = first; bz < last; ++bz) {
      for (int64_t by = 0; by < blocks(size.y); ++by) {
        for (int64_t bx = 0; bx < blocks(size.x); ++bx) {
          if (live != nullptr && !live->IsRead(by, bz, bx, reach)) {
            continue;
          }
          for (int64_t z = bz * kEdge; z < std::min(size.z, (bz + 1) * kEdge); ++z) {
            const float* from =
                grid.values.data() + (z * size.y + by * kEdge) * size.x + bx * kEdge;
            float* to = turned->data() + bx * kEdge * slice_stride_ + z * row_stride_ + by * kEdge;
            HWY_DYNAMIC_DISPATCH(Turn)
            (from, size.x, std::min(kEdge, size.x - bx * kEdge),
             std::min(kEdge, size.y - by * kEdge), to, slice_stride_);
          }
        }
      }
    }
  });
}

}  // namespace fovea::render
#endif  // HWY_ONCE
