#include "engine/render/live_blocks.h"

#include <algorithm>
#include <limits>

namespace fovea::render {

TransparentValues::TransparentValues(const TransferFunction& transfer) {
  const auto& points = transfer.points;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double from = -kInfinity;
  bool open = points.front().opacity <= 0;  // an interval that starts at `from` is being followed
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    const bool here = points[i].opacity <= 0;
    const bool next = points[i + 1].opacity <= 0;
    if (here && !open) {
      from = points[i].value;
      open = true;
    }
    if (here && !next) {
      intervals_.push_back({from, points[i].value});
      open = false;
    }
  }
  if (points.back().opacity <= 0) {
    intervals_.push_back({open ? from : points.back().value, kInfinity});
  }
}

bool TransparentValues::Cover(float low, float high) const {
  for (const Interval& interval : intervals_) {
    if (low >= interval.low && high <= interval.high) {
      return true;
    }
  }
  return false;
}

LiveBlocks::LiveBlocks(const ValueBlocks& blocks, const Box3& box,
                       const TransparentValues& transparent, const ShearView& view)
    : low_u_(box.lo[view.axis_u]),
      low_v_(box.lo[view.axis_v]),
      low_k_(box.lo[view.axis_k]),
      count_u_(blocks.count[view.axis_u]),
      count_v_(blocks.count[view.axis_v]),
      count_k_(blocks.count[view.axis_k]) {
  live_.resize(blocks.low.size());
  Int3 at;
  size_t i = 0;
  for (int64_t k = 0; k < count_k_; ++k) {
    at[view.axis_k] = k;
    for (int64_t v = 0; v < count_v_; ++v) {
      at[view.axis_v] = v;
      for (int64_t u = 0; u < count_u_; ++u, ++i) {
        at[view.axis_u] = u;
        const size_t block = blocks.Index(at.x, at.y, at.z);
        live_[i] = transparent.Cover(blocks.low[block], blocks.high[block]) ? 0 : 1;
      }
    }
  }
}

bool LiveBlocks::IsRead(int64_t u, int64_t v, int64_t k, int reach) const {
  for (int64_t bk = std::max<int64_t>(k - reach, 0); bk <= std::min(k + reach, count_k_ - 1);
       ++bk) {
    for (int64_t bv = std::max<int64_t>(v - 1, 0); bv <= std::min(v + reach, count_v_ - 1); ++bv) {
      for (int64_t bu = std::max<int64_t>(u - 1, 0); bu <= std::min(u + reach, count_u_ - 1);
           ++bu) {
        if (live_[static_cast<size_t>((bk * count_v_ + bv) * count_u_ + bu)] != 0) {
          return true;
        }
      }
    }
  }
  return false;
}

}  // namespace fovea::render
