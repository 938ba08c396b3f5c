#ifndef ENGINE_RENDER_SLICE_VIEW_H_
#define ENGINE_RENDER_SLICE_VIEW_H_

#include <cstdint>
#include <vector>

#include "engine/render/live_blocks.h"
#include "engine/render/view.h"
#include "engine/volume/grid.h"

namespace fovea::render {

/// Slices of a grid along the principal axis, rows contiguous along u. For principal axis x the
/// values are copied, turned; otherwise this only points into the grid, which must outlive it.
class SliceView {
 public:
  /// The copy goes into `turned`, which must outlive this and is only ever enlarged. With `live`,
  /// only what samples of live blocks read is turned, the rest is left as it is. `reach`: 0 if
  /// samples read the taps p and p + 1 on u and v, 1 if they also take gradients.
  SliceView(const Grid& grid, const ShearView& view, int threads, std::vector<float>* turned,
            const LiveBlocks* live = nullptr, int reach = 0);
  /// The value at u of row v of slice k is Row(v, k)[u]; all in the grid's coordinates.
  [[nodiscard]] const float* Row(int64_t v, int64_t k) const {
    return base_ + v * row_stride_ + k * slice_stride_;
  }
  [[nodiscard]] int64_t row_stride() const { return row_stride_; }
  [[nodiscard]] int64_t slice_stride() const { return slice_stride_; }

 private:
  const float* base_ = nullptr;  // of the position (0, 0, 0), which may lie outside
  int64_t row_stride_ = 0, slice_stride_ = 0;
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SLICE_VIEW_H_
