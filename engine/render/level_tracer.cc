#include "engine/render/level_tracer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "engine/render/lighting.h"

namespace fovea::render {

namespace {

/// A field of colours shares the kernel's way of looking up with the one of opacities.
bool UsesTables(bool with_colors, const RenderSettings& settings) {
  return KernelFunction::NeedsTable(settings.transfer) ||
         (with_colors && KernelFunction::NeedsTable(settings.color_transfer));
}

double MostOpacity(const TransferFunction& transfer) {
  float most = 0;
  for (const TransferFunction::Point& point : transfer.points) {
    most = std::max(most, point.opacity);
  }
  return most;
}

}  // namespace

FrameInputs::FrameInputs(const RetainedSet& retained, bool with_colors, const ShearView& sheared,
                         const Matrix4& to_world, const RenderSettings& wanted)
    : fovea(retained.fovea().at),
      view(sheared),
      index_to_world(to_world),
      settings(wanted),
      function(wanted.transfer, UsesTables(with_colors, wanted)),
      color_function(with_colors ? wanted.color_transfer : wanted.transfer,
                     UsesTables(with_colors, wanted)),
      transparent(wanted.transfer) {
  if (wanted.lighting.enabled) {
    light = MakeLight(wanted.lighting, wanted.transfer, sheared, to_world);
  }
}

LevelTracer::LevelTracer(const FrameInputs& frame, const LevelValues& values,
                         std::span<const SlicePlan> plans, Layer* layer)
    : frame_(frame),
      layer_(*layer),
      live_(values.blocks, values.grid.box, frame.transparent, frame.view),
      slices_(values.grid, frame.view, frame.settings.threads, values.turned,
              frame.Skips() ? &live_ : nullptr, frame.light ? 1 : 0),
      cover_(static_cast<double>(layer->plan.width) * frame.view.step_length,
             MostOpacity(frame.settings.transfer)) {
  if (values.color != nullptr) {
    color_slices_.emplace(*values.color, frame.view, frame.settings.threads, values.color_turned,
                          frame.Skips() ? &live_ : nullptr, 0);
  }
  for (const SlicePlan& plan : plans) {
    // Pixel i samples at i + shift in cell-centre coordinates: four taps of constant weight.
    const double whole_u = std::floor(plan.shift.u);
    const double whole_v = std::floor(plan.shift.v);
    Slice slice;
    slice.plan = &plan;
    slice.whole_u = static_cast<int64_t>(whole_u);
    slice.whole_v = static_cast<int64_t>(whole_v);
    slice.fu = static_cast<float>(plan.shift.u - whole_u);
    slice.fv = static_cast<float>(plan.shift.v - whole_v);
    prepared_.push_back(slice);
  }
}

uint64_t LevelTracer::TraceRows(Side side, int64_t v0, int64_t v1, SpentPixels* spent,
                                const std::vector<float>* reach) const {
  constexpr int kSlicesBetweenLooks = 16;
  if (side == Side::kFront) {
    MarkSplit(v0, v1);
  }
  uint64_t samples = 0;
  int since_look = 0;
  std::vector<SlabRun> runs;
  for (const Slice& slice : prepared_) {
    const int64_t first = std::max(v0, slice.plan->owned.v0);
    const int64_t last = std::min(v1, slice.plan->owned.v1);
    runs.clear();
    for (int64_t v = first; v < last; ++v) {
      samples += AddRow(slice, side, v, *spent, &runs);
    }
    if (!runs.empty()) {
      Composite(slice, side, runs);
    }
    if (reach != nullptr && ++since_look == kSlicesBetweenLooks) {
      since_look = 0;
      for (int64_t v = v0; v < v1; ++v) {
        FindSpent(side, v, *reach, spent);
      }
    }
  }
  return samples;
}

void LevelTracer::MarkSplit(int64_t v0, int64_t v1) const {
  Rect marked;
  for (const Slice& slice : prepared_) {
    const Rect& child = slice.plan->child;
    if (child == marked || child.IsEmpty()) {
      continue;
    }
    marked = child;
    for (int64_t v = std::max(v0, child.v0); v < std::min(v1, child.v1); ++v) {
      std::fill_n(&layer_.split[layer_.Index(child.u0, v)], child.Width(), uint8_t{1});
    }
  }
}

uint64_t LevelTracer::AddRow(const Slice& slice, Side side, int64_t v, const SpentPixels& spent,
                             std::vector<SlabRun>* runs) const {
  const SlicePlan& plan = *slice.plan;
  const Range all{plan.owned.u0, plan.owned.u1};
  if (plan.place != SlicePlan::Place::kWithin) {
    const bool behind = plan.place == SlicePlan::Place::kBehind;
    return behind == (side == Side::kBack) ? AddRange(slice, side, v, all, spent, runs) : 0;
  }
  if (v >= plan.back.v0 && v < plan.back.v1) {
    return side == Side::kBack ? AddRange(slice, side, v, all, spent, runs) : 0;
  }
  // Columns beyond the leaving edge go to the back, the child's to the child, the rest to front.
  const int64_t back0 = std::clamp(plan.back.u0, all.begin, all.end);
  const Range back{back0, std::clamp(plan.back.u1, back0, all.end)};
  if (side == Side::kBack) {
    return AddRange(slice, side, v, back, spent, runs);
  }
  Range child{all.begin, all.begin};
  if (v >= plan.child.v0 && v < plan.child.v1 && plan.child.u1 > plan.child.u0) {
    child = {plan.child.u0, plan.child.u1};
  }
  uint64_t samples = 0;
  int64_t at = all.begin;
  const bool back_first = back.begin <= child.begin;
  for (const Range& hole : {back_first ? back : child, back_first ? child : back}) {
    if (hole.begin < hole.end) {
      samples += AddRange(slice, side, v, {at, hole.begin}, spent, runs);
      at = hole.end;
    }
  }
  return samples + AddRange(slice, side, v, {at, all.end}, spent, runs);
}

uint64_t LevelTracer::AddRange(const Slice& slice, Side side, int64_t v, Range range,
                               const SpentPixels& spent, std::vector<SlabRun>* runs) const {
  const Rect& inside = slice.plan->in_volume;
  range.begin = std::max(range.begin, inside.u0);
  range.end = std::min(range.end, inside.u1);
  if (range.begin >= range.end || v < inside.v0 || v >= inside.v1) {
    return 0;
  }
  CountDepth(slice, side == Side::kFront ? &layer_.front : &layer_.back, v, range);
  const int64_t tap = (v + slice.whole_v) * slices_.row_stride() + slice.whole_u;
  const auto pixel = static_cast<int64_t>(layer_.Index(0, v));
  ForEachLive(slice, v, range, spent, [&](Range run) {
    runs->push_back({tap + run.begin, pixel + run.begin, run.end - run.begin});
  });
  return static_cast<uint64_t>(range.end - range.begin);
}

/// Calls `body` for the parts of a range where something may be seen.
template <typename Body>
void LevelTracer::ForEachLive(const Slice& slice, int64_t v, Range range, const SpentPixels& spent,
                              const Body& body) const {
  if (!frame_.Skips()) {
    body(range);
    return;
  }
  const uint8_t* live = live_.Row(v + slice.whole_v, slice.plan->k);
  const auto unspent = [&](Range run) {
    if (!spent.any) {
      body(run);
      return;
    }
    const int64_t u0 = layer_.plan.rect.u0;
    const uint8_t* row = spent.runs.data() + (v - layer_.plan.rect.v0) * spent.runs_in_row;
    const auto end_of = [&](int64_t i) {
      return std::min(run.end, u0 + ((i - u0) / SpentPixels::kRun + 1) * SpentPixels::kRun);
    };
    for (int64_t i = run.begin; i < run.end;) {
      const int64_t begin = i;
      while (i < run.end && row[(i - u0) / SpentPixels::kRun] == 0) {
        i = end_of(i);
      }
      if (begin < i) {
        body(Range{begin, i});
      } else {
        i = end_of(i);
      }
    }
  };
  int64_t block = live_.BlockOf(range.begin + slice.whole_u);
  for (int64_t i = range.begin; i < range.end;) {
    const int64_t begin = i;
    const bool shows = live[block] != 0;
    while (i < range.end && (live[block] != 0) == shows) {
      i = live_.FirstOf(++block) - slice.whole_u;
    }
    i = std::min(i, range.end);
    if (shows) {
      unspent({begin, i});
    }
  }
}

void LevelTracer::Composite(const Slice& slice, Side side, const std::vector<SlabRun>& runs) const {
  Gathered& into = side == Side::kFront ? layer_.front : layer_.back;
  Slab slab;
  slab.taps = slices_.Row(0, slice.plan->k);
  slab.row_stride = slices_.row_stride();
  slab.slice_stride = slices_.slice_stride();
  slab.fu = slice.fu;
  slab.fv = slice.fv;
  slab.length = static_cast<float>(static_cast<double>(layer_.plan.width) * slice.plan->thickness *
                                   frame_.view.step_length);
  slab.cover = slice.plan->thickness == 1.0 ? &cover_ : nullptr;
  slab.red = into.red.data();
  slab.green = into.green.data();
  slab.blue = into.blue.data();
  slab.transmittance = into.transmittance.data();
  if (color_slices_) {
    slab.color_taps = color_slices_->Row(0, slice.plan->k);
  }
  if (!frame_.IsWeighted()) {
    CallKernel(slab, runs);
    return;
  }
  for (const SlabRun& run : runs) {
    CompositeWeighted(slice, run, slab);
  }
}

void LevelTracer::CompositeWeighted(const Slice& slice, const SlabRun& run, Slab slab) const {
  constexpr int64_t kAtOnce = 128;
  std::array<float, kAtOnce> opacity_scale;
  std::array<float, kAtOnce> length_scale;
  const int64_t row_width = layer_.plan.rect.Width();
  const int64_t v = layer_.plan.rect.v0 + run.pixel / row_width;
  const int64_t u = layer_.plan.rect.u0 + run.pixel % row_width;
  const WeightedRow row =
      MakeWeightedRow(frame_.view, frame_.index_to_world, frame_.fovea, frame_.settings, v,
                      slice.plan->k, static_cast<double>(layer_.plan.width), slice.plan->thickness);
  const bool falls_off = frame_.settings.weighting.kind == Weighting::Kind::kFalloff;
  for (int64_t done = 0; done < run.count; done += kAtOnce) {
    const SlabRun part{run.tap + done, run.pixel + done, std::min(kAtOnce, run.count - done)};
    for (int64_t i = 0; falls_off && i < part.count; ++i) {
      opacity_scale[static_cast<size_t>(i)] = static_cast<float>(row.Falloff(u + done + i));
    }
    float most = 0;
    for (int64_t i = 0; frame_.IsCut() && i < part.count; ++i) {
      const float kept = row.KeptLength(u + done + i) / slab.length;
      length_scale[static_cast<size_t>(i)] = kept;
      most = std::max(most, kept);
    }
    if (frame_.IsCut() && most <= 0) {
      continue;
    }
    slab.opacity_scale = falls_off ? opacity_scale.data() - part.pixel : nullptr;
    slab.length_scale = frame_.IsCut() ? length_scale.data() - part.pixel : nullptr;
    CallKernel(slab, {&part, 1});
  }
}

void LevelTracer::CallKernel(const Slab& slab, std::span<const SlabRun> runs) const {
  if (frame_.settings.compositing == Compositing::kMaximum) {
    MaximumSlab(slab, runs);
  } else {
    CompositeSlab(frame_.function, frame_.color_function, frame_.light ? &*frame_.light : nullptr,
                  slab, runs);
  }
}

/// Skipped samples count too. Without chop all pixels of a run count alike, so only the ends of the
/// run are marked, and summed up once all slices are done.
void LevelTracer::CountDepth(const Slice& slice, Gathered* into, int64_t v, Range range) const {
  const SlicePlan& plan = *slice.plan;
  const auto thickness = static_cast<float>(plan.thickness);
  float* depth = into->depth.data() + layer_.Index(layer_.plan.rect.u0, v);
  const int64_t u0 = layer_.plan.rect.u0;
  if (!frame_.IsCut()) {
    depth[range.begin - u0] += thickness;
    if (range.end < layer_.plan.rect.u1) {
      depth[range.end - u0] -= thickness;
    }
    return;
  }
  const auto width = static_cast<double>(layer_.plan.width);
  const WeightedRow row = MakeWeightedRow(frame_.view, frame_.index_to_world, frame_.fovea,
                                          frame_.settings, v, plan.k, width, plan.thickness);
  const auto length = static_cast<float>(row.length);
  for (int64_t i = range.begin; i < range.end; ++i) {
    depth[i - u0] += thickness * row.KeptLength(i) / length;
  }
}

void LevelTracer::FindSpent(Side side, int64_t v, const std::vector<float>& reach,
                            SpentPixels* spent) const {
  const int64_t width = layer_.plan.rect.Width();
  const size_t row = layer_.Index(layer_.plan.rect.u0, v);
  uint8_t* runs = spent->runs.data() + (v - layer_.plan.rect.v0) * spent->runs_in_row;
  for (int64_t r = 0; r < spent->runs_in_row; ++r) {
    float most = 0;
    const int64_t end = std::min(width, (r + 1) * SpentPixels::kRun);
    for (int64_t i = r * SpentPixels::kRun; i < end; ++i) {
      const size_t at = row + static_cast<size_t>(i);
      const float behind = side == Side::kBack ? layer_.back.transmittance[at] : 1.0F;
      most = std::max(most, reach[at] * layer_.front.transmittance[at] * behind);
    }
    if (most < frame_.settings.spent_transmittance) {
      runs[r] = 1;
    }
  }
}

void ClearLayer(const FrameInputs& frame, LevelPlan plan, Layer* layer) {
  const auto pixels = static_cast<size_t>(plan.rect.Width() * plan.rect.Height());
  layer->plan = std::move(plan);
  layer->front.Clear(pixels);
  layer->back.Clear(pixels);
  layer->split.assign(pixels, 0);
  if (frame.settings.compositing == Compositing::kMaximum) {
    for (Gathered* side : {&layer->front, &layer->back}) {
      side->red.assign(pixels, -std::numeric_limits<float>::infinity());
    }
  }
}

namespace {

/// Runs were marked at their ends.
void SumUpDepths(const Layer& layer, Gathered* side) {
  const Rect& rect = layer.plan.rect;
  for (int64_t v = rect.v0; v < rect.v1; ++v) {
    float* depth = side->depth.data() + layer.Index(rect.u0, v);
    for (int64_t i = 1; i < rect.Width(); ++i) {
      depth[i] += depth[i - 1];
    }
  }
}

/// Each pixel's maximum is the largest of its ancestors'. Leaves take its appearance as what they
/// have gathered; split pixels hand on nothing.
void ShowMaxima(const TransferFunction& transfer, std::vector<Layer>* layers) {
  for (size_t l = 0; l < layers->size(); ++l) {
    Layer& layer = (*layers)[l];
    const Rect& rect = layer.plan.rect;
    for (int64_t v = rect.v0; v < rect.v1; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        const size_t i = layer.Index(u, v);
        float& most = layer.front.red[i];
        most = std::max(most, layer.back.red[i]);
        if (l > 0) {
          const Layer& parent = (*layers)[l - 1];
          most = std::max(most, parent.front.red[parent.Index(u >> 1, v >> 1)]);
        }
      }
    }
  }
  for (Layer& layer : *layers) {
    for (size_t i = 0; i < layer.split.size(); ++i) {
      const float most = layer.front.red[i];
      const bool shows = layer.split[i] == 0 && std::isfinite(most);
      const Appearance a = shows ? AppearanceOf(transfer, most) : Appearance{};
      layer.front.Set(
          i, {static_cast<float>(a.opacity * a.red), static_cast<float>(a.opacity * a.green),
              static_cast<float>(a.opacity * a.blue), static_cast<float>(1 - a.opacity)});
      layer.back.Set(i, Pixel{});
    }
  }
}

}  // namespace

void FinishLayers(const FrameInputs& frame, std::vector<Layer>* layers) {
  for (Layer& layer : *layers) {
    if (!frame.IsCut()) {
      SumUpDepths(layer, &layer.front);
      SumUpDepths(layer, &layer.back);
    }
  }
  if (frame.settings.compositing == Compositing::kMaximum) {
    ShowMaxima(frame.settings.transfer, layers);
  }
}

}  // namespace fovea::render
