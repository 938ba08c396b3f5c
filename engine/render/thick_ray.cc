#include "engine/render/thick_ray.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "engine/base/parallel.h"

namespace fovea::render {

void Gathered::Clear(size_t pixels) {
  for (std::vector<float>* plane : {&red, &green, &blue, &depth}) {
    plane->assign(pixels, 0.0F);
  }
  transmittance.assign(pixels, 1.0F);
}

WeightedRow MakeWeightedRow(const ShearView& view, const Matrix4& index_to_world, const Vec3& fovea,
                            const Weighting& weighting, int64_t v, int64_t k, double width,
                            double thickness) {
  const double z = static_cast<double>(k) + thickness / 2;
  Vec3 at;
  at[view.axis_u] = width * (0.5 + view.slope_u * z);
  at[view.axis_v] = width * (static_cast<double>(v) + 0.5 + view.slope_v * z);
  at[view.axis_k] = width * z;
  Vec3 step;
  step[view.axis_u] = width;
  const double scale = 1 / index_to_world.SmallestSpacing();
  WeightedRow row;
  row.weighting = weighting;
  row.first = scale * index_to_world.TransformDirection(at - fovea);
  row.step = scale * index_to_world.TransformDirection(step);
  row.sight = view.sight;
  row.length = width * thickness * view.step_length;
  return row;
}

namespace {

/// A run of pixels [begin, end) of one row of one slice, into one of the accumulators.
struct Run {
  const float* row0;  // taps of pixel i: row0[i], row0[i + 1], row1[i], row1[i + 1]
  const float* row1;
  float fu, fv;  // weights of the second taps
  int64_t begin, end;
  Gathered* into;
  int64_t at;  // where pixel 0 is there
};

class LevelTracer {
 public:
  LevelTracer(const Grid& grid, const SuperVoxels& volume, const ShearView& view,
              const Matrix4& index_to_world, const RenderSettings& settings,
              const TransferTable& table, Layer* layer)
      : slices_(grid, view, settings.threads),
        fovea_(volume.retained.fovea().at),
        view_(view),
        index_to_world_(index_to_world),
        settings_(settings),
        table_(table),
        layer_(*layer) {}

  /// All slices for the rows [v0, v1) of the image; returns the samples classified.
  uint64_t TraceRows(int64_t v0, int64_t v1) {
    uint64_t samples = 0;
    for (const SlicePlan& slice : layer_.plan.slices) {
      const int64_t first = std::max(v0, slice.owned.v0);
      const int64_t last = std::min(v1, slice.owned.v1);
      for (int64_t v = first; v < last; ++v) {
        samples += TraceRow(slice, v);
      }
    }
    return samples;
  }

 private:
  uint64_t TraceRow(const SlicePlan& slice, int64_t v) {
    const int64_t begin = slice.owned.u0;
    const int64_t end = slice.owned.u1;
    if (slice.place == SlicePlan::Place::kBehind) {
      return CompositeRun(slice, v, begin, end, true);
    }
    if (slice.place == SlicePlan::Place::kBefore) {
      return CompositeRun(slice, v, begin, end, false);
    }
    if (v >= slice.back.v0 && v < slice.back.v1) {
      return CompositeRun(slice, v, begin, end, true);
    }
    // Columns beyond the leaving edge go to the back, the child's to the child, the rest to front.
    const int64_t back0 = std::clamp(slice.back.u0, begin, end);
    const int64_t back1 = std::clamp(slice.back.u1, back0, end);
    int64_t child0 = begin;
    int64_t child1 = begin;
    if (v >= slice.child.v0 && v < slice.child.v1 && slice.child.u1 > slice.child.u0) {
      child0 = slice.child.u0;
      child1 = slice.child.u1;
      std::fill_n(&layer_.split[layer_.Index(child0, v)], child1 - child0, uint8_t{1});
    }
    uint64_t samples = CompositeRun(slice, v, back0, back1, true);
    int64_t at = begin;
    for (const auto& [lo, hi] : Ordered({back0, back1}, {child0, child1})) {
      if (lo < hi) {
        samples += CompositeRun(slice, v, at, lo, false);
        at = hi;
      }
    }
    return samples + CompositeRun(slice, v, at, end, false);
  }

  using Range = std::pair<int64_t, int64_t>;
  static std::array<Range, 2> Ordered(const Range& a, const Range& b) {
    return a.first <= b.first ? std::array{a, b} : std::array{b, a};
  }

  uint64_t CompositeRun(const SlicePlan& slice, int64_t v, int64_t begin, int64_t end, bool back) {
    begin = std::max(begin, slice.in_volume.u0);
    end = std::min(end, slice.in_volume.u1);
    if (begin >= end || v < slice.in_volume.v0 || v >= slice.in_volume.v1) {
      return 0;
    }
    // Pixel i samples at i + shift in cell-centre coordinates: four taps of constant weight.
    const double whole_u = std::floor(slice.shift.u);
    const double whole_v = std::floor(slice.shift.v);
    const int64_t tap_v = v + static_cast<int64_t>(whole_v);
    const size_t row_start = layer_.Index(layer_.plan.rect.u0, v);
    const int64_t u0 = layer_.plan.rect.u0;
    Run run;
    run.row0 = slices_.Row(tap_v, slice.k) + static_cast<int64_t>(whole_u);
    run.row1 = slices_.Row(tap_v + 1, slice.k) + static_cast<int64_t>(whole_u);
    run.fu = static_cast<float>(slice.shift.u - whole_u);
    run.fv = static_cast<float>(slice.shift.v - whole_v);
    run.begin = begin;
    run.end = end;
    run.into = back ? &layer_.back : &layer_.front;
    run.at = static_cast<int64_t>(row_start) - u0;
    Composite(run, slice, v);
    return static_cast<uint64_t>(end - begin);
  }

  void Composite(const Run& run, const SlicePlan& slice, int64_t v) const {
    const auto width = static_cast<double>(layer_.plan.width);
    const auto thickness = static_cast<float>(slice.thickness);
    const auto length = static_cast<float>(width * slice.thickness * view_.step_length);
    if (settings_.weighting.kind == Weighting::Kind::kNone) {
      Each(run, [=](int64_t, float sigma, float* depth) {
        *depth += thickness;
        return sigma * length;
      });
      return;
    }
    const WeightedRow row = MakeWeightedRow(view_, index_to_world_, fovea_, settings_.weighting, v,
                                            slice.k, width, slice.thickness);
    if (settings_.weighting.kind == Weighting::Kind::kChop) {
      Each(run, [=](int64_t i, float sigma, float* depth) {
        const float kept = row.KeptLength(i);
        *depth += thickness * kept / length;
        return sigma * kept;
      });
    } else {
      Each(run, [=](int64_t i, float sigma, float* depth) {
        *depth += thickness;
        return sigma > 0 ? FalloffDepth(sigma, row.Falloff(i), row.length) : 0.0F;
      });
    }
  }

  /// `optical_depth(i, sigma, &depth)` weighs the slab and counts its depth.
  template <typename OpticalDepth>
  void Each(const Run& run, const OpticalDepth& optical_depth) const {
    const TransferTable::Entry* entries = table_.entries();
    const float offset = table_.offset();
    const float scale = table_.scale();
    const float w00 = (1 - run.fu) * (1 - run.fv);
    const float w01 = run.fu * (1 - run.fv);
    const float w10 = (1 - run.fu) * run.fv;
    const float w11 = run.fu * run.fv;
    for (int64_t i = run.begin; i < run.end; ++i) {
      const float value =
          (w00 * run.row0[i] + w01 * run.row0[i + 1]) + (w10 * run.row1[i] + w11 * run.row1[i + 1]);
      const Classified c = Classify(entries, offset, scale, value);
      const auto at = static_cast<size_t>(run.at + i);
      const float tau = optical_depth(i, c.sigma, &run.into->depth[at]);
      if (tau > 0) {
        Pixel pixel = run.into->At(at);
        Accumulate(c, tau, &pixel);
        run.into->Set(at, pixel);
      }
    }
  }

  SliceView slices_;
  Vec3 fovea_;
  const ShearView& view_;
  const Matrix4& index_to_world_;
  const RenderSettings& settings_;
  const TransferTable& table_;
  Layer& layer_;
};

Layer EmptyLayer(LevelPlan plan) {
  const auto pixels = static_cast<size_t>(plan.rect.Width() * plan.rect.Height());
  Layer layer;
  layer.plan = std::move(plan);
  layer.front.Clear(pixels);
  layer.back.Clear(pixels);
  layer.split.resize(pixels);
  return layer;
}

}  // namespace

std::vector<Layer> TraceThickRays(const SuperVoxels& volume, const ShearView& view,
                                  const Matrix4& index_to_world, const RenderSettings& settings,
                                  uint64_t* samples) {
  constexpr int64_t kRowsInBand = 8;
  const TransferTable table(settings.transfer);
  std::atomic<uint64_t> total{0};
  std::vector<Layer> layers;
  for (LevelPlan& plan : PlanLevels(volume.retained, view)) {
    Layer& layer = layers.emplace_back(EmptyLayer(std::move(plan)));
    LevelTracer tracer(volume.levels[layer.plan.level], volume, view, index_to_world, settings,
                       table, &layer);
    ParallelFor(layer.plan.rect.v0, layer.plan.rect.v1, kRowsInBand, settings.threads,
                [&](int64_t v0, int64_t v1) { total += tracer.TraceRows(v0, v1); });
  }
  if (samples != nullptr) {
    *samples = total;
  }
  return layers;
}

}  // namespace fovea::render
