#include "engine/render/fused.h"

#include <algorithm>
#include <optional>

#include "engine/base/stopwatch.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/level_tracer.h"
#include "engine/wavelet/haar.h"

namespace fovea::render {
namespace {

/// Slices of a level that are reconstructed and traced together.
constexpr int64_t kSlicesAtOnce = 8;
/// As thick as chunks of a store, so that each is decoded once.
constexpr int64_t kDetailLayer = 16;

/// One field: the slices of every level that are at hand, and the detail they come from.
class SliceStack {
 public:
  SliceStack(CoefficientSource& source, const RetainedSet& retained, int axis, int64_t margin)
      : source_(source), retained_(retained), axis_(axis), margin_(margin) {
    const auto levels = static_cast<size_t>(retained.hierarchy().finest()) + 1;
    slices_.resize(levels);
    detail_.resize(levels);
  }

  /// The whole of level 0, with its apron.
  Status ReadCoarsest(FusedStats* stats) {
    const Stopwatch watch;
    const Int3 dims = retained_.hierarchy().DimsAt(0);
    Grid inner(Box3::OfSize(dims));
    FOVEA_RETURN_IF_ERROR(source_.ReadCoarse(inner.values));
    slices_[0] = WholeVolume(inner, {}, 1).levels.front();
    stats->read_ms += watch.ElapsedMs();
    return absl::OkStatus();
  }

  /// Level l + 1's slices [first, last) from the slices of level l that are at hand.
  Status MakeChildren(int level, int64_t first, int64_t last, FusedStats* stats) {
    Box3 box = retained_.box(level + 1).Grown(kApron);
    box.lo[axis_] = first - margin_;
    box.hi[axis_] = last + margin_;
    FOVEA_RETURN_IF_ERROR(FetchDetail(level, box.lo[axis_] >> 1, (box.hi[axis_] + 1) >> 1, stats));
    const Stopwatch watch;
    Grid& child = slices_[static_cast<size_t>(level) + 1];
    child.box = box;
    child.values.resize(static_cast<size_t>(box.Volume()));
    const Detail& detail = detail_[static_cast<size_t>(level)];
    wavelet::InverseHaarLevel(slices_[static_cast<size_t>(level)], detail.box, detail.values,
                              retained_.hierarchy().DimsAt(level + 1), 1, &child);
    stats->reconstruct_ms += watch.ElapsedMs();
    return absl::OkStatus();
  }

  [[nodiscard]] const Grid& At(int level) const { return slices_[static_cast<size_t>(level)]; }

  [[nodiscard]] uint64_t Bytes() const {
    size_t values = 0;
    for (size_t l = 0; l < slices_.size(); ++l) {
      values += slices_[l].values.capacity() + detail_[l].values.capacity();
    }
    return sizeof(float) * values;
  }

 private:
  struct Detail {
    Box3 box;
    std::vector<float> values;
  };

  /// Makes the layers of detail that lead to the children of slices [first, last) be at hand.
  Status FetchDetail(int level, int64_t first, int64_t last, FusedStats* stats) {
    Detail& detail = detail_[static_cast<size_t>(level)];
    const Box3& window = retained_.window(level);
    first = std::clamp(first, window.lo[axis_], window.hi[axis_]);
    last = std::clamp(last, first, window.hi[axis_]);
    if (first == last ||
        (!detail.values.empty() && first >= detail.box.lo[axis_] && last <= detail.box.hi[axis_])) {
      return absl::OkStatus();
    }
    const Stopwatch watch;
    detail.box = window;
    detail.box.lo[axis_] = std::max(window.lo[axis_], first / kDetailLayer * kDetailLayer);
    detail.box.hi[axis_] =
        std::min(window.hi[axis_], (last + kDetailLayer - 1) / kDetailLayer * kDetailLayer);
    detail.values.resize(static_cast<size_t>(7 * detail.box.Volume()));
    FOVEA_RETURN_IF_ERROR(source_.ReadDetail(level, detail.box, detail.values));
    retained_.Weigh(level, detail.box, detail.values);
    stats->read_ms += watch.ElapsedMs();
    return absl::OkStatus();
  }

  CoefficientSource& source_;
  const RetainedSet& retained_;
  int axis_;
  int64_t margin_;  // slices beyond those asked for, as gradients need
  std::vector<Grid> slices_;
  std::vector<Detail> detail_;
};

class FusedTracer {
 public:
  FusedTracer(const FrameInputs& frame, const RetainedSet& retained, SliceStack* values,
              SliceStack* colors, TraceScratch* scratch, FusedStats* stats)
      : frame_(frame),
        hierarchy_(retained.hierarchy()),
        values_(*values),
        colors_(colors),
        stats_(*stats),
        scratch_(*scratch),
        layers_(scratch->layers),
        reach_(scratch->reach),
        left_(scratch->left) {
    std::vector<LevelPlan> plans = PlanLevels(retained, frame.view);
    layers_.resize(plans.size());
    for (size_t l = 0; l < plans.size(); ++l) {
      ClearLayer(frame, std::move(plans[l]), &layers_[l]);
    }
    next_.resize(layers_.size());
    reach_.resize(layers_.size());
    reach_[0].assign(layers_[0].split.size(), 1.0F);
    left_.resize(layers_.size());
    scratch->turned.resize(layers_.size());
    scratch->color_turned.resize(layers_.size());
  }

  Status Run() {
    FOVEA_RETURN_IF_ERROR(values_.ReadCoarsest(&stats_));
    if (colors_ != nullptr) {
      FOVEA_RETURN_IF_ERROR(colors_->ReadCoarsest(&stats_));
    }
    FOVEA_RETURN_IF_ERROR(TraceSlices(0, 0, layers_[0].plan.slices.size()));
    FinishLayers(frame_, &layers_);
    return absl::OkStatus();
  }

 private:
  /// The slices [first, last) of a level's plan, which are at hand, and all that lies in them.
  Status TraceSlices(size_t l, size_t first, size_t last) {
    Layer& layer = layers_[l];
    const Grid& grid = values_.At(layer.plan.level);
    const ValueBlocks blocks = MakeValueBlocks(grid, 1);
    const std::span<const SlicePlan> plans(layer.plan.slices.data() + first, last - first);
    const LevelTracer tracer(
        frame_,
        {grid, blocks, colors_ != nullptr ? &colors_->At(layer.plan.level) : nullptr,
         &scratch_.turned[l], &scratch_.color_turned[l]},
        plans, &layer);
    SpentPixels spent = SpentByParents(l);
    for (const auto side : {LevelTracer::Side::kFront, LevelTracer::Side::kBack}) {
      stats_.samples +=
          tracer.TraceRows(side, layer.plan.rect.v0, layer.plan.rect.v1, &spent, nullptr);
    }
    return l + 1 < layers_.size() ? TraceChildren(l, plans) : absl::OkStatus();
  }

  /// The children of slices, a few at a time. Plans of a level follow one another as their parents
  /// do.
  Status TraceChildren(size_t l, std::span<const SlicePlan> parents) {
    const std::vector<SlicePlan>& children = layers_[l + 1].plan.slices;
    const int64_t depth = hierarchy_.DimsAt(layers_[l + 1].plan.level)[frame_.view.axis_k];
    size_t begin = next_[l + 1];
    size_t end = begin;
    for (size_t p = 0; p < parents.size(); ++p) {
      if (!parents[p].child.IsEmpty()) {
        end += 2 * parents[p].k + 1 < depth ? 2 : 1;
      }
      const bool full = end - begin >= static_cast<size_t>(kSlicesAtOnce);
      if (begin == end || (!full && p + 1 < parents.size())) {
        continue;
      }
      const auto [low, high] = std::minmax(children[begin].k, children[end - 1].k);
      const int level = layers_[l].plan.level;
      FOVEA_RETURN_IF_ERROR(values_.MakeChildren(level, low, high + 1, &stats_));
      if (colors_ != nullptr) {
        FOVEA_RETURN_IF_ERROR(colors_->MakeChildren(level, low, high + 1, &stats_));
      }
      stats_.peak_bytes = std::max(stats_.peak_bytes,
                                   values_.Bytes() + (colors_ != nullptr ? colors_->Bytes() : 0));
      next_[l + 1] = end;
      FOVEA_RETURN_IF_ERROR(TraceSlices(l + 1, begin, end));
      begin = end;
    }
    return absl::OkStatus();
  }

  /// As far as their fronts have come: what they will yet meet lies behind these slices.
  SpentPixels SpentByParents(size_t l) {
    SpentPixels spent;
    if (l == 0 || frame_.SpentLimit() <= 0) {
      spent.Clear(layers_[l].plan.rect);
      return spent;
    }
    LeftBehindFront(layers_[l - 1], reach_[l - 1], &left_[l - 1]);
    PassDownReach(layers_[l - 1], left_[l - 1], layers_[l], &reach_[l]);
    FindSpentChildren(layers_[l - 1], left_[l - 1], layers_[l], frame_.SpentLimit(),
                      /*whole_neighbourhood=*/true, &spent);
    return spent;
  }

  const FrameInputs& frame_;
  const Hierarchy& hierarchy_;
  SliceStack& values_;
  SliceStack* colors_;
  FusedStats& stats_;
  TraceScratch& scratch_;
  std::vector<Layer>& layers_;
  std::vector<std::vector<float>>& reach_;
  std::vector<std::vector<float>>& left_;
  std::vector<size_t> next_;  // by level: the first slice that was not traced yet
};

}  // namespace

Status TraceFused(CoefficientSource& source, CoefficientSource* color, const RetainedSet& retained,
                  const ShearView& view, const Matrix4& index_to_world,
                  const RenderSettings& settings, TraceScratch* scratch, FusedStats* stats) {
  if (source.basis() != fovea::Basis{} || (color != nullptr && color->basis() != fovea::Basis{})) {
    return FailedPrecondition(
        "fused rendering is for Haar coefficients in float32; render two-phase instead");
  }
  const FrameInputs frame(retained, color != nullptr, view, index_to_world, settings);
  const int64_t margin = settings.lighting.enabled ? 1 : 0;
  SliceStack values(source, retained, view.axis_k, margin);
  std::optional<SliceStack> colors;
  if (color != nullptr) {
    colors.emplace(*color, retained, view.axis_k, margin);
  }
  FusedStats counted;
  FusedTracer tracer(frame, retained, &values, colors ? &*colors : nullptr, scratch, &counted);
  FOVEA_RETURN_IF_ERROR(tracer.Run());
  if (stats != nullptr) {
    *stats = counted;
  }
  return absl::OkStatus();
}

}  // namespace fovea::render
