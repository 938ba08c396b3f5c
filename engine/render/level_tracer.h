#ifndef ENGINE_RENDER_LEVEL_TRACER_H_
#define ENGINE_RENDER_LEVEL_TRACER_H_

#include <optional>
#include <span>
#include <vector>

#include "engine/render/live_blocks.h"
#include "engine/render/slab_kernel.h"
#include "engine/render/slice_view.h"
#include "engine/render/spent_pixels.h"
#include "engine/render/thick_ray.h"

namespace fovea::render {

/// What is the same for all levels of a frame.
struct FrameInputs {
  FrameInputs(const RetainedSet& retained, bool with_colors, const ShearView& sheared,
              const Matrix4& to_world, const RenderSettings& wanted);
  /// Whether samples weigh differently along a row.
  [[nodiscard]] bool IsWeighted() const {
    return settings.weighting.kind != Weighting::Kind::kNone || !settings.clip.IsEmpty();
  }
  /// Whether parts of slabs are cut away.
  [[nodiscard]] bool IsCut() const {
    return settings.weighting.kind == Weighting::Kind::kChop || !settings.clip.IsEmpty();
  }

  /// Whether transparent blocks say nothing. A maximum may be a transparent value.
  [[nodiscard]] bool Skips() const { return settings.compositing != Compositing::kMaximum; }
  /// Below what transmittance a pixel is spent. Maxima never are.
  [[nodiscard]] float SpentLimit() const {
    return settings.compositing == Compositing::kMaximum ? 0.0F : settings.spent_transmittance;
  }

  Vec3 fovea;
  const ShearView& view;
  const Matrix4& index_to_world;
  const RenderSettings& settings;
  KernelFunction function, color_function;
  std::optional<KernelLight> light;
  TransparentValues transparent;
};

/// What a tracer reads: super-voxels of one level, all or those of some slices.
struct LevelValues {
  const Grid& grid;
  const ValueBlocks& blocks;
  const Grid* color = nullptr;  // a second field on the same box, or null
  /// Where values are turned for views along x.
  std::vector<float>* turned = nullptr;
  std::vector<float>* color_turned = nullptr;
};

/// Traces the rays of one level through slices it owns.
class LevelTracer {
 public:
  enum class Side { kFront, kBack };

  /// For the slices of `plans`, which are some of the layer's. `values` must hold their taps.
  LevelTracer(const FrameInputs& frame, const LevelValues& values, std::span<const SlicePlan> plans,
              Layer* layer);

  /// All slices of one side for the rows [v0, v1) of the image, which no other thread touches.
  /// Skips what is transparent and the pixels of `spent`. With `reach` (what the ray lets through
  /// before this level, a value a pixel) rows also find out by themselves when they are spent: only
  /// for a level without children. Returns the samples met, skipped ones too.
  uint64_t TraceRows(Side side, int64_t v0, int64_t v1, SpentPixels* spent,
                     const std::vector<float>* reach) const;

 private:
  /// A slice with all that its rows share.
  struct Slice {
    const SlicePlan* plan;
    int64_t whole_u, whole_v;
    float fu, fv;
  };
  /// A run of pixels [begin, end) of row v.
  struct Range {
    int64_t begin, end;
  };

  void MarkSplit(int64_t v0, int64_t v1) const;
  /// Collects the runs of a row of pixels where something may be seen; returns the samples met.
  uint64_t AddRow(const Slice& slice, Side side, int64_t v, const SpentPixels& spent,
                  std::vector<SlabRun>* runs) const;
  uint64_t AddRange(const Slice& slice, Side side, int64_t v, Range range, const SpentPixels& spent,
                    std::vector<SlabRun>* runs) const;
  template <typename Body>
  void ForEachLive(const Slice& slice, int64_t v, Range range, const SpentPixels& spent,
                   const Body& body) const;
  void Composite(const Slice& slice, Side side, const std::vector<SlabRun>& runs) const;
  void CompositeWeighted(const Slice& slice, const SlabRun& run, Slab slab) const;
  void CountDepth(const Slice& slice, Gathered* into, int64_t v, Range range) const;
  void FindSpent(Side side, int64_t v, const std::vector<float>& reach, SpentPixels* spent) const;
  void CallKernel(const Slab& slab, std::span<const SlabRun> runs) const;

  const FrameInputs& frame_;
  Layer& layer_;
  LiveBlocks live_;
  SliceView slices_;
  std::optional<SliceView> color_slices_;
  SlabCover cover_;  // of slabs one slice thick
  std::vector<Slice> prepared_;
};

/// Makes `layer` an image of a level on which nothing was traced yet.
void ClearLayer(const FrameInputs& frame, LevelPlan plan, Layer* layer);
/// What is left to do once all slices of all levels are traced: depths are summed up, maxima become
/// what they look like.
void FinishLayers(const FrameInputs& frame, std::vector<Layer>* layers);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_LEVEL_TRACER_H_
