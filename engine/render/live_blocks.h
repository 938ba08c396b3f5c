#ifndef ENGINE_RENDER_LIVE_BLOCKS_H_
#define ENGINE_RENDER_LIVE_BLOCKS_H_

#include <cstdint>
#include <vector>

#include "engine/fovea/value_blocks.h"
#include "engine/render/transfer_function.h"
#include "engine/render/view.h"

namespace fovea::render {

/// The values that a transfer function leaves wholly transparent, as closed intervals.
class TransparentValues {
 public:
  explicit TransparentValues(const TransferFunction& transfer);
  /// Whether all values in [low, high] are transparent.
  [[nodiscard]] bool Cover(float low, float high) const;

 private:
  struct Interval {
    double low, high;
  };
  std::vector<Interval> intervals_;
};

/// Which blocks of a level's super-voxels show anything under a transfer function, in the order
/// (k, v, u) in which a view's slices meet them.
class LiveBlocks {
 public:
  /// `box`: where the level's grid lies.
  LiveBlocks(const ValueBlocks& blocks, const Box3& box, const TransparentValues& transparent,
             const ShearView& view);

  /// The flags along u for the samples whose first taps lie in row v of slice k, which must be in
  /// the grid. Flag b is for first taps u with BlockOf(u) = b.
  [[nodiscard]] const uint8_t* Row(int64_t v, int64_t k) const {
    return live_.data() +
           (((k - low_k_) / ValueBlocks::kEdge) * count_v_ + (v - low_v_) / ValueBlocks::kEdge) *
               count_u_;
  }
  /// Whether a sample whose first tap lies in a live block reads values of block (u, v, k) (in
  /// blocks): its second taps lie up to one block further; with `reach` 1 also gradients'.
  [[nodiscard]] bool IsRead(int64_t u, int64_t v, int64_t k, int reach) const;
  [[nodiscard]] int64_t BlockOf(int64_t u) const { return (u - low_u_) / ValueBlocks::kEdge; }
  /// The first u of block b.
  [[nodiscard]] int64_t FirstOf(int64_t b) const { return low_u_ + b * ValueBlocks::kEdge; }

 private:
  std::vector<uint8_t> live_;
  int64_t low_u_ = 0, low_v_ = 0, low_k_ = 0;
  int64_t count_u_ = 0, count_v_ = 0, count_k_ = 0;
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_LIVE_BLOCKS_H_
