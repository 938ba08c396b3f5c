#include "engine/render/thick_ray.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>

#include "engine/base/parallel.h"
#include "engine/render/level_tracer.h"

namespace fovea::render {

void Gathered::Clear(size_t pixels) {
  for (std::vector<float>* plane : {&red, &green, &blue, &depth}) {
    plane->assign(pixels, 0.0F);
  }
  transmittance.assign(pixels, 1.0F);
}

WeightedRow MakeWeightedRow(const ShearView& view, const Matrix4& index_to_world, const Vec3& fovea,
                            const RenderSettings& settings, int64_t v, int64_t k, double width,
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
  row.weighting = settings.weighting;
  row.first = scale * index_to_world.TransformDirection(at - fovea);
  row.step = scale * index_to_world.TransformDirection(step);
  row.length = width * thickness * view.step_length;
  if (settings.weighting.kind == Weighting::Kind::kChop) {
    row.Keep({Dot(row.first, view.sight), Dot(row.step, view.sight), 1});
  }
  // The way of a ray through the voxels, for a path of one smallest spacing.
  Vec3 way;
  const double slice = (view.ascending ? 1 : -1) / view.step_length;
  way[view.axis_u] = slice * view.slope_u;
  way[view.axis_v] = slice * view.slope_v;
  way[view.axis_k] = slice;
  for (int axis = 0; settings.clip.box && axis < 3; ++axis) {
    const auto& [low, high] = *settings.clip.box;
    row.Keep({at[axis] - low[axis], step[axis], way[axis]});
    row.Keep({high[axis] - at[axis], -step[axis], -way[axis]});
  }
  for (const ClipPlane& plane : settings.clip.planes) {
    row.Keep(
        {Dot(plane.normal, at) - plane.offset, Dot(plane.normal, step), Dot(plane.normal, way)});
  }
  return row;
}

namespace {

Layer EmptyLayer(LevelPlan plan) {
  const auto pixels = static_cast<size_t>(plan.rect.Width() * plan.rect.Height());
  Layer layer;
  layer.plan = std::move(plan);
  layer.front.Clear(pixels);
  layer.back.Clear(pixels);
  layer.split.resize(pixels);
  return layer;
}

/// One frame's rays: fronts from the coarsest level to the finest, then backs from the finest to
/// the coarsest, so that each knows which pixels are spent: ALGORITHM, skip.
class FrameTracer {
 public:
  FrameTracer(const FrameInputs& frame, std::vector<LevelPlan> plans) : frame_(frame) {
    layers_.reserve(plans.size());
    for (LevelPlan& plan : plans) {
      Layer& layer = layers_.emplace_back(EmptyLayer(std::move(plan)));
      tracers_.push_back(std::make_unique<LevelTracer>(frame, &layer));
      reach_.emplace_back(layer.split.size(), 1.0F);
      left_.emplace_back();
    }
  }

  uint64_t TraceAll() {
    if (frame_.settings.compositing == Compositing::kMaximum) {
      return TraceMaxima();
    }
    for (size_t l = 0; l < layers_.size(); ++l) {
      SpentPixels spent = l == 0 ? NoneSpent(0) : SpentInFront(l);
      Trace(LevelTracer::Side::kFront, l, &spent);
    }
    for (size_t l = layers_.size(); l-- > 0;) {
      SpentPixels spent = SpentBehind(l);
      Trace(LevelTracer::Side::kBack, l, &spent);
      MeasureLeft(l);
    }
    return samples_;
  }

  /// Maxima need no order: both sides of every level, then each pixel's is the largest of its
  /// ancestors'. Leaves take its appearance as what they have gathered; split pixels hand on
  /// nothing.
  uint64_t TraceMaxima() {
    for (size_t l = 0; l < layers_.size(); ++l) {
      Layer& layer = layers_[l];
      for (Gathered* side : {&layer.front, &layer.back}) {
        std::fill(side->red.begin(), side->red.end(), -std::numeric_limits<float>::infinity());
      }
      for (const auto side : {LevelTracer::Side::kFront, LevelTracer::Side::kBack}) {
        SpentPixels none = NoneSpent(l);
        Trace(side, l, &none);
      }
      for (int64_t v = layer.plan.rect.v0; v < layer.plan.rect.v1; ++v) {
        for (int64_t u = layer.plan.rect.u0; u < layer.plan.rect.u1; ++u) {
          const size_t i = layer.Index(u, v);
          float& most = layer.front.red[i];
          most = std::max(most, layer.back.red[i]);
          if (l > 0 && layers_[l - 1].plan.rect.Contains(u >> 1, v >> 1)) {
            most = std::max(most, layers_[l - 1].front.red[layers_[l - 1].Index(u >> 1, v >> 1)]);
          }
        }
      }
    }
    for (Layer& layer : layers_) {
      for (size_t i = 0; i < layer.split.size(); ++i) {
        const float most = layer.front.red[i];
        layer.back.Set(i, Pixel{});
        const bool shows = layer.split[i] == 0 && std::isfinite(most);
        const Appearance a = shows ? AppearanceOf(frame_.settings.transfer, most) : Appearance{};
        layer.front.Set(
            i, {static_cast<float>(a.opacity * a.red), static_cast<float>(a.opacity * a.green),
                static_cast<float>(a.opacity * a.blue), static_cast<float>(1 - a.opacity)});
      }
    }
    return samples_;
  }

  std::vector<Layer> Take() { return std::move(layers_); }

 private:
  void Trace(LevelTracer::Side side, size_t l, SpentPixels* spent) {
    constexpr int64_t kRowsInBand = 8;
    const Rect& rect = layers_[l].plan.rect;
    // A level whose pixels are never split may end a ray wherever it is spent.
    const bool ends_rays = l + 1 == layers_.size() && frame_.settings.spent_transmittance > 0 &&
                           frame_.settings.compositing != Compositing::kMaximum;
    spent->any = spent->any || ends_rays;
    ParallelFor(
        rect.v0, rect.v1, kRowsInBand, frame_.settings.threads, [&](int64_t v0, int64_t v1) {
          samples_ += tracers_[l]->TraceRows(side, v0, v1, spent, ends_rays ? &reach_[l] : nullptr);
        });
  }

  SpentPixels NoneSpent(size_t l) const {
    SpentPixels spent;
    spent.Clear(layers_[l].plan.rect);
    return spent;
  }

  /// Marks the runs of level l whose pixels are all `is_spent(u, v)`.
  template <typename IsSpent>
  SpentPixels Mark(size_t l, const IsSpent& is_spent) const {
    const Rect& rect = layers_[l].plan.rect;
    SpentPixels spent = NoneSpent(l);
    for (int64_t v = rect.v0; v < rect.v1; ++v) {
      for (int64_t r = 0; r < spent.runs_in_row; ++r) {
        const int64_t begin = rect.u0 + r * SpentPixels::kRun;
        bool all = true;
        for (int64_t u = begin; all && u < std::min(begin + SpentPixels::kRun, rect.u1); ++u) {
          all = is_spent(u, v);
        }
        spent.runs[static_cast<size_t>((v - rect.v0) * spent.runs_in_row + r)] = all ? 1 : 0;
        spent.any = spent.any || all;
      }
    }
    return spent;
  }

  /// Whether `left` is below the limit in pixel (u, v) of level l and in all pixels around it that
  /// are split, with which smooth splitting mixes it.
  bool SpentAround(size_t l, const std::vector<float>& left, int64_t u, int64_t v) const {
    const Layer& layer = layers_[l];
    for (int64_t dv = -1; dv <= 1; ++dv) {
      for (int64_t du = -1; du <= 1; ++du) {
        if ((layer.IsSplit(u + du, v + dv) || (du == 0 && dv == 0)) &&
            left[layer.Index(u + du, v + dv)] >= frame_.settings.spent_transmittance) {
          return false;
        }
      }
    }
    return true;
  }

  /// What a level's pixels inherit: how much of the ray is left, and whether that is too little.
  SpentPixels SpentInFront(size_t l) {
    const Layer& parent = layers_[l - 1];
    std::vector<float> behind(parent.split.size());
    float least = 1;
    for (size_t i = 0; i < behind.size(); ++i) {
      behind[i] = reach_[l - 1][i] * parent.front.transmittance[i];
      least = std::min(least, behind[i]);
    }
    const Layer& layer = layers_[l];
    const Rect& rect = layer.plan.rect;
    for (int64_t v = rect.v0; v < rect.v1; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        reach_[l][layer.Index(u, v)] = behind[parent.Index(u >> 1, v >> 1)];
      }
    }
    if (least >= frame_.settings.spent_transmittance) {
      return NoneSpent(l);
    }
    return Mark(l, [&](int64_t u, int64_t v) {
      return !parent.IsSplit(u >> 1, v >> 1) || SpentAround(l - 1, behind, u >> 1, v >> 1);
    });
  }

  /// Before the back of level l is traced: what is left of the ray there.
  SpentPixels SpentBehind(size_t l) {
    const Layer& layer = layers_[l];
    std::vector<float>& left = left_[l];
    left.resize(layer.split.size());
    float least = 1;
    const Rect& rect = layer.plan.rect;
    for (int64_t v = rect.v0; v < rect.v1; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        const size_t i = layer.Index(u, v);
        left[i] = layer.split[i] != 0 ? MostOfChildren(l, u, v)
                                      : reach_[l][i] * layer.front.transmittance[i];
        least = std::min(least, left[i]);
      }
    }
    if (least >= frame_.settings.spent_transmittance) {
      return NoneSpent(l);
    }
    return Mark(l, [&](int64_t u, int64_t v) {
      const size_t i = layer.Index(u, v);
      return layer.split[i] != 0 ? SpentAround(l, left, u, v)
                                 : left[i] < frame_.settings.spent_transmittance;
    });
  }

  float MostOfChildren(size_t l, int64_t u, int64_t v) const {
    const Layer& finer = layers_[l + 1];
    const size_t i = finer.Index(2 * u, 2 * v);
    const auto width = static_cast<size_t>(finer.plan.rect.Width());
    const std::vector<float>& left = left_[l + 1];
    return std::max(std::max(left[i], left[i + 1]), std::max(left[i + width], left[i + width + 1]));
  }

  /// After it is traced: what is left of the ray for the coarser level's back.
  void MeasureLeft(size_t l) {
    for (size_t i = 0; i < left_[l].size(); ++i) {
      left_[l][i] *= layers_[l].back.transmittance[i];
    }
  }

  const FrameInputs& frame_;
  std::vector<Layer> layers_;
  std::vector<std::unique_ptr<LevelTracer>> tracers_;
  std::vector<std::vector<float>> reach_;  // what a ray lets through before the level
  std::vector<std::vector<float>> left_;   // what is left of it behind
  std::atomic<uint64_t> samples_{0};
};

}  // namespace

std::vector<Layer> TraceThickRays(const SuperVoxels& volume, const SuperVoxels* color,
                                  const ShearView& view, const Matrix4& index_to_world,
                                  const RenderSettings& settings, uint64_t* samples) {
  const FrameInputs frame(volume, color, view, index_to_world, settings);
  FrameTracer tracer(frame, PlanLevels(volume.retained, view));
  const uint64_t met = tracer.TraceAll();
  if (samples != nullptr) {
    *samples = met;
  }
  return tracer.Take();
}

}  // namespace fovea::render
