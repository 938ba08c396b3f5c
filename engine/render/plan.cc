#include "engine/render/plan.h"

#include <algorithm>

#include "engine/fovea/reconstruct.h"
#include "engine/render/sheared_slices.h"

namespace fovea::render {
namespace {

int64_t Area(const Rect& rect) {
  return rect.IsEmpty() ? 0 : rect.Width() * rect.Height();
}

int64_t SamplesOf(const SlicePlan& slice) {
  return Area(Intersect(slice.owned, slice.in_volume)) -
         Area(Intersect(slice.child, slice.in_volume));
}

/// Both phases at their fullest: while the finest level is made, its detail and all super-voxels;
/// while rays are combined or smoothed, super-voxels and intermediate images.
int64_t MemoryBytes(const RetainedSet& retained, const ShearView& view, const FrameCounts& counts) {
  constexpr int64_t kFloat = sizeof(float);
  // Front, back and what is left of a ray (13 floats), the image pyramid and its smoothed form
  // (4 and 5), and what children inherit while they are combined.
  constexpr int64_t kBytesPerAccumulatorPixel = 160;
  constexpr int64_t kBytesPerPicturePixel = 4 * kFloat;
  constexpr int64_t kFixedBytes = 1 << 20;  // tables, plans, bookkeeping
  const Hierarchy& hierarchy = retained.hierarchy();
  int64_t values = 0;
  int64_t most_detail = 0;
  for (int level = 0; level <= hierarchy.finest(); ++level) {
    if (retained.box(level).IsEmpty()) {
      break;
    }
    values += retained.box(level).Grown(kApron).Volume();
    if (level < hierarchy.finest()) {
      most_detail = std::max(most_detail, 7 * retained.window(level).Volume());
    }
  }
  // Slices across x are copied, turned.
  const int64_t turned = view.axis_k == 0 ? values : 0;
  const int64_t render = kFloat * turned + kBytesPerAccumulatorPixel * counts.accumulator_pixels +
                         kBytesPerPicturePixel * counts.picture_pixels;
  return kFixedBytes + kFloat * values + std::max(kFloat * most_detail, render);
}

}  // namespace

FrameCounts CountFrame(const RetainedSet& retained, const ShearView& view, int width_px,
                       int height_px) {
  FrameCounts counts;
  counts.super_voxels = retained.SuperVoxelCount();
  counts.picture_pixels = int64_t{width_px} * height_px;
  for (const LevelPlan& level : PlanLevels(retained, view)) {
    counts.accumulator_pixels += Area(level.rect);
    for (const SlicePlan& slice : level.slices) {
      counts.samples += SamplesOf(slice);
    }
  }
  counts.memory_bytes = MemoryBytes(retained, view, counts);
  return counts;
}

FrameTime PredictTime(const FrameCounts& counts, uint64_t chunks, uint64_t bytes, int threads,
                      const CostModel& model) {
  const double speed = 1 + model.gain_per_thread * (std::max(threads, 1) - 1);
  const auto ms = [speed](double ns_each, int64_t count) {
    return 1e-6 * ns_each * static_cast<double>(count) / speed;
  };
  FrameTime time;
  time.read_ms = ms(1e3 * model.us_per_chunk, static_cast<int64_t>(chunks)) +
                 ms(model.ns_per_byte, static_cast<int64_t>(bytes));
  time.reconstruct_ms = ms(model.ns_per_super_voxel, counts.super_voxels);
  time.render_ms = ms(model.ns_per_sample, counts.samples) +
                   ms(model.ns_per_accumulator_pixel, counts.accumulator_pixels);
  time.smooth_warp_ms = ms(model.ns_per_picture_pixel, counts.picture_pixels) +
                        ms(model.ns_per_smoothed_pixel, counts.accumulator_pixels);
  return time;
}

}  // namespace fovea::render
