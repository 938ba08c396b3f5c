#include "engine/render/plan.h"

#include <atomic>
#include <cstdlib>
#include <new>
#include <random>

#include <gtest/gtest.h>
#include <malloc.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/renderer.h"
#include "engine/render/thick_ray.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace {

/// What this program's `new` has given out and not got back, and the most it ever had.
std::atomic<int64_t> g_held{0};
std::atomic<int64_t> g_most{0};

void* Given(void* block) {
  if (block == nullptr) {
    std::abort();
  }
  const int64_t held = g_held += static_cast<int64_t>(malloc_usable_size(block));
  int64_t most = g_most;
  while (held > most && !g_most.compare_exchange_weak(most, held)) {
  }
  return block;
}

void TakenBack(void* block) {
  g_held -= static_cast<int64_t>(malloc_usable_size(block));
  std::free(block);
}

}  // namespace

// Every other form of new and delete comes down to these four.
void* operator new(size_t bytes) {
  return Given(std::malloc(bytes));
}
void* operator new(size_t bytes, std::align_val_t alignment) {
  const auto edge = static_cast<size_t>(alignment);
  return Given(std::aligned_alloc(edge, (bytes + edge - 1) / edge * edge));
}
void operator delete(void* block) noexcept {
  TakenBack(block);
}
void operator delete(void* block, size_t) noexcept {
  TakenBack(block);
}
void operator delete(void* block, std::align_val_t) noexcept {
  TakenBack(block);
}
void operator delete(void* block, size_t, std::align_val_t) noexcept {
  TakenBack(block);
}

namespace fovea::render {
namespace {

using testing::MakeCoefficients;
using testing::MakeWavyGrid;

RenderSettings Look(double azimuth, double elevation, int size) {
  RenderSettings settings;
  settings.view.azimuth_deg = azimuth;
  settings.view.elevation_deg = elevation;
  settings.transfer = {{{0, {0.2F, 0.4F, 0.6F}, 0.001F}, {1, {1, 1, 1}, 0.002F}}};
  settings.width_px = settings.height_px = size;
  return settings;
}

ShearView ViewOf(const RenderSettings& settings, const Int3& dims) {
  return FactorView(settings.view, dims, Matrix4{}, settings.width_px, settings.height_px);
}

TEST(PlanTest, SamplesAndPixelsAreThoseOfTheFrame) {
  std::mt19937 random(11);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<>(low, high)(random);
  };
  for (int trial = 0; trial < 24; ++trial) {
    const Int3 dims{20 + trial, 70 - 2 * trial, 33};
    const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
    MemorySource source(set);
    const Fovea fovea{{uniform(0, static_cast<double>(dims.x)),
                       uniform(0, static_cast<double>(dims.y)), uniform(0, 33)},
                      uniform(1, 40),
                      trial % 2 == 0 ? WindowShape::kCube : WindowShape::kSphere};
    const RetainedSet retained = RetainedSet::Make(set.hierarchy, fovea).value();
    ASSERT_OK_AND_ASSIGN(const SuperVoxels volume, Reconstruct(source, retained, 1));
    const RenderSettings settings = Look(uniform(-180, 180), uniform(-90, 90), 40);
    const ShearView view = ViewOf(settings, dims);
    const FrameCounts counts = CountFrame(retained, view, 40, 40);
    RenderStats stats;
    ASSERT_OK(RenderFoveated(volume, Matrix4{}, settings, &stats));
    EXPECT_EQ(counts.samples, static_cast<int64_t>(stats.samples));
    int64_t pixels = 0;
    for (const Layer& layer : TraceThickRays(volume, nullptr, view, Matrix4{}, settings,
                                             static_cast<uint64_t*>(nullptr))) {
      pixels += layer.plan.rect.Width() * layer.plan.rect.Height();
    }
    EXPECT_EQ(counts.accumulator_pixels, pixels);
    EXPECT_EQ(counts.super_voxels, retained.SuperVoxelCount());
    EXPECT_EQ(counts.picture_pixels, 1600);
  }
}

TEST(PlanTest, MemoryIsAnUpperBoundAndNotAWildOne) {
  const Int3 dims{128, 128, 128};
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
  MemorySource source(set);
  for (const double rate : {8.0, 25.0, 60.0, 128.0}) {
    for (const auto& [azimuth, elevation] : {std::pair(0.0, 0.0), {100.0, 30.0}, {20.0, 80.0}}) {
      const RenderSettings settings = Look(azimuth, elevation, 200);
      const RetainedSet retained = RetainedSet::Make(set.hierarchy, {{60, 60, 60}, rate}).value();
      const int64_t planned = CountFrame(retained, ViewOf(settings, dims), 200, 200).memory_bytes;
      const int64_t before = g_held;
      g_most = before;
      {
        ASSERT_OK_AND_ASSIGN(const SuperVoxels volume, Reconstruct(source, retained, 0));
        ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(volume, Matrix4{}, settings));
      }
      const int64_t used = g_most - before;
      std::printf("rate %g, view %g,%g: at most %.2f MB, used %.2f\n", rate, azimuth, elevation,
                  1e-6 * static_cast<double>(planned), 1e-6 * static_cast<double>(used));
      EXPECT_LE(used, planned) << "rate " << rate << ", view " << azimuth << "," << elevation;
      EXPECT_LE(planned, 3 * used + (2 << 20));
    }
  }
}

TEST(PlanTest, TimeIsLinearInTheCounts) {
  FrameCounts counts;
  counts.super_voxels = 1000;
  counts.samples = 2000;
  counts.accumulator_pixels = 300;
  counts.picture_pixels = 400;
  CostModel model;
  model.us_per_chunk = 1;
  model.ns_per_byte = 2;
  model.ns_per_super_voxel = 3;
  model.ns_per_sample = 4;
  model.ns_per_accumulator_pixel = 5;
  model.ns_per_picture_pixel = 6;
  model.ns_per_smoothed_pixel = 7;
  model.gain_per_thread = 0.5;
  const FrameTime one = PredictTime(counts, 7, 50, 1, model);
  EXPECT_DOUBLE_EQ(one.read_ms, 1e-6 * (7 * 1000 + 50 * 2));
  EXPECT_DOUBLE_EQ(one.reconstruct_ms, 1e-6 * 3000);
  EXPECT_DOUBLE_EQ(one.render_ms, 1e-6 * (8000 + 1500));
  EXPECT_DOUBLE_EQ(one.smooth_warp_ms, 1e-6 * (2400 + 2100));
  EXPECT_DOUBLE_EQ(PredictTime(counts, 7, 50, 3, model).Total(), one.Total() / 2);
}

}  // namespace
}  // namespace fovea::render
