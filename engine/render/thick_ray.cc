#include "engine/render/thick_ray.h"

#include <algorithm>
#include <atomic>
#include <cmath>
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

/// One frame's rays: fronts from the coarsest level to the finest, then backs from the finest to
/// the coarsest, so that each knows which pixels are spent.
class FrameTracer {
 public:
  FrameTracer(const FrameInputs& frame, const SuperVoxels& volume, const SuperVoxels* color,
              std::vector<LevelPlan> plans, TraceScratch* scratch)
      : frame_(frame), layers_(scratch->layers), reach_(scratch->reach), left_(scratch->left) {
    layers_.resize(plans.size());
    reach_.resize(plans.size());
    left_.resize(plans.size());
    scratch->turned.resize(plans.size());
    scratch->color_turned.resize(plans.size());
    for (size_t l = 0; l < plans.size(); ++l) {
      ClearLayer(frame, std::move(plans[l]), &layers_[l]);
      Layer& layer = layers_[l];
      const auto level = static_cast<size_t>(layer.plan.level);
      const LevelValues values{volume.levels[level], volume.blocks[level],
                               color != nullptr ? &color->levels[level] : nullptr,
                               &scratch->turned[l], &scratch->color_turned[l]};
      tracers_.push_back(std::make_unique<LevelTracer>(frame, values, layer.plan.slices, &layer));
    }
  }

  uint64_t TraceAll() {
    const float limit = frame_.SpentLimit();
    SpentPixels spent;
    for (size_t l = 0; l < layers_.size(); ++l) {
      if (l == 0) {
        reach_[0].assign(layers_[0].split.size(), 1.0F);
        spent.Clear(layers_[0].plan.rect);
      } else {
        LeftBehindFront(layers_[l - 1], reach_[l - 1], &left_[l - 1]);
        PassDownReach(layers_[l - 1], left_[l - 1], layers_[l], &reach_[l]);
        FindSpentChildren(layers_[l - 1], left_[l - 1], layers_[l], limit,
                          /*whole_neighbourhood=*/false, &spent);
      }
      Trace(LevelTracer::Side::kFront, l, &spent);
    }
    for (size_t l = layers_.size(); l-- > 0;) {
      LeftBehindFront(layers_[l], reach_[l], &left_[l]);
      TakeMostOfChildren(l);
      FindSpent(layers_[l], left_[l], limit, &spent);
      Trace(LevelTracer::Side::kBack, l, &spent);
      for (size_t i = 0; i < left_[l].size(); ++i) {
        left_[l][i] *= layers_[l].back.transmittance[i];
      }
    }
    FinishLayers(frame_, &layers_);
    return samples_;
  }

 private:
  void Trace(LevelTracer::Side side, size_t l, SpentPixels* spent) {
    constexpr int64_t kRowsInBand = 8;
    const Rect& rect = layers_[l].plan.rect;
    // A level whose pixels are never split may end a ray wherever it is spent.
    const bool ends_rays = l + 1 == layers_.size() && frame_.SpentLimit() > 0;
    spent->any = spent->any || ends_rays;
    ParallelFor(
        rect.v0, rect.v1, kRowsInBand, frame_.settings.threads, [&](int64_t v0, int64_t v1) {
          samples_ += tracers_[l]->TraceRows(side, v0, v1, spent, ends_rays ? &reach_[l] : nullptr);
        });
  }

  /// Behind a split pixel's children as much is left as behind the best of them.
  void TakeMostOfChildren(size_t l) {
    const Layer& layer = layers_[l];
    const Rect& rect = layer.plan.rect;
    for (int64_t v = rect.v0; l + 1 < layers_.size() && v < rect.v1; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        if (layer.IsSplit(u, v)) {
          const Layer& finer = layers_[l + 1];
          const float* near = left_[l + 1].data() + finer.Index(2 * u, 2 * v);
          const float* far = near + finer.plan.rect.Width();
          left_[l][layer.Index(u, v)] =
              std::max(std::max(near[0], near[1]), std::max(far[0], far[1]));
        }
      }
    }
  }

  const FrameInputs& frame_;
  std::vector<Layer>& layers_;
  std::vector<std::vector<float>>& reach_;
  std::vector<std::vector<float>>& left_;
  std::vector<std::unique_ptr<LevelTracer>> tracers_;
  std::atomic<uint64_t> samples_{0};
};

}  // namespace

uint64_t TraceThickRays(const SuperVoxels& volume, const SuperVoxels* color, const ShearView& view,
                        const Matrix4& index_to_world, const RenderSettings& settings,
                        TraceScratch* scratch) {
  const FrameInputs frame(volume.retained, color != nullptr, view, index_to_world, settings);
  return FrameTracer(frame, volume, color, PlanLevels(volume.retained, view), scratch).TraceAll();
}

std::vector<Layer> TraceThickRays(const SuperVoxels& volume, const SuperVoxels* color,
                                  const ShearView& view, const Matrix4& index_to_world,
                                  const RenderSettings& settings, uint64_t* samples) {
  TraceScratch scratch;
  const uint64_t met = TraceThickRays(volume, color, view, index_to_world, settings, &scratch);
  if (samples != nullptr) {
    *samples = met;
  }
  return std::move(scratch.layers);
}

}  // namespace fovea::render
