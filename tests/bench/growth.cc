#include <array>
#include <cstdio>
#include <cstring>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/render/renderer.h"
#include "tests/bench/frame_clock.h"
#include "tests/bench/scenes.h"
#include "tests/bench/separable_source.h"
#include "tests/bench/workloads.h"

namespace fovea::bench {
namespace {

/// The phases of the frames of one size of volume.
struct Phases {
  std::vector<double> rebuild, rays, warp, large_rays, large_warp;
};

struct Row {
  double m, rebuild, rays, warp, frame, large_frame;
};

Status MeasureSize(int64_t n, int threads, Buffers* buffers, double* m, Phases* phases) {
  const auto middle = 0.5 * static_cast<double>(n);
  const Vec3 fovea{middle, middle, middle};
  FOVEA_ASSIGN_OR_RETURN(SeparableSource source, MakeScaleFreeSource(n, fovea));
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(source.hierarchy(), {fovea, 40}));
  SuperVoxels volume;
  FOVEA_ASSIGN_OR_RETURN(const double rebuild_ms,
                         TimeReconstruct(source, retained, threads, &volume));
  *m = static_cast<double>(retained.CoefficientCount());
  phases->rebuild.push_back(rebuild_ms);
  render::RenderSettings settings = ScaleFreeSettings(n, 45, threads);
  FOVEA_ASSIGN_OR_RETURN(const FrameTimes large, TimeFrame(volume, settings, buffers));
  phases->large_rays.push_back(large.rays_ms);
  phases->large_warp.push_back(large.smooth_warp_ms);
  settings.width_px = settings.height_px = 512;
  for (int repeat = 0; repeat < 3; ++repeat) {
    FOVEA_ASSIGN_OR_RETURN(const FrameTimes small, TimeFrame(volume, settings, buffers));
    if (repeat > 0) {  // the first finds the large picture's buffers
      phases->rays.push_back(small.rays_ms);
      phases->warp.push_back(small.smooth_warp_ms);
    }
  }
  return absl::OkStatus();
}

}  // namespace

Status RunGrowth(int rounds, int threads) {
  constexpr std::array<int64_t, 3> kSizes = {1024, 2048, 4096};
  std::array<Phases, 3> phases;
  std::array<double, 3> m{};
  std::array<Buffers, 3> buffers;
  for (int round = 0; round < rounds; ++round) {
    for (size_t i = 0; i < kSizes.size(); ++i) {
      FOVEA_RETURN_IF_ERROR(MeasureSize(kSizes[i], threads, &buffers[i], &m[i], &phases[i]));
    }
  }
  std::printf("growth: rate 40, 45 degrees, medians in ms; (x: over n = 1024)\n");
  std::printf("%5s %16s %8s %15s %15s %17s %19s\n", "n", "m", "rebuild", "rays", "smooth, warp",
              "frame 512^2", "frame n x n");
  std::array<Row, 3> rows{};
  for (size_t i = 0; i < kSizes.size(); ++i) {
    Row& row = rows[i];
    row = {m[i], Median(phases[i].rebuild), Median(phases[i].rays), Median(phases[i].warp), 0, 0};
    row.frame = row.rebuild + row.rays + row.warp;
    row.large_frame = row.rebuild + Median(phases[i].large_rays) + Median(phases[i].large_warp);
    std::printf("%5lld %9.0f (%.2f) %8.1f %8.2f (%.2f) %8.2f (%.2f) %9.2f (%.2f) %10.2f (%.2f)\n",
                static_cast<long long>(kSizes[i]), row.m, row.m / rows[0].m, row.rebuild, row.rays,
                row.rays / rows[0].rays, row.warp, row.warp / rows[0].warp, row.frame,
                row.frame / rows[0].frame, row.large_frame, row.large_frame / rows[0].large_frame);
  }
  std::printf(
      "rays grow %.2f times as much as m (at most 1.1 is wanted); the paper's frame grew "
      "6.86 x from 1024 to 4096\n",
      rows[2].rays / rows[0].rays / (rows[2].m / rows[0].m));
  return absl::OkStatus();
}

Status RunSmoothing(int rounds, int threads) {
  constexpr int kSide = 1024;
  FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume("procedural256"));
  FOVEA_ASSIGN_OR_RETURN(const CoefficientSet set, Transform(volume));
  MemorySource source(set);
  std::printf("smoothing and warp to %d x %d, RGBA float, medians\n%5s %9s %12s %10s %7s\n", kSide,
              kSide, "rate", "ms", "ns a pixel", "memset ms", "ratio");
  for (const double rate : {25.0, 40.0, 100.0}) {
    FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                           RetainedSet::Make(set.hierarchy, {volume.fovea, rate}));
    FOVEA_ASSIGN_OR_RETURN(const SuperVoxels foveated, Reconstruct(source, retained, threads));
    render::RenderSettings settings =
        SettingsFor(volume.dims, 30, TransferFor(volume.name, false), threads);
    settings.width_px = settings.height_px = kSide;
    std::vector<double> warp, set_ms;
    Buffers buffers;
    std::vector<float> picture(size_t{4} * kSide * kSide);
    for (int round = 0; round < rounds; ++round) {
      FOVEA_ASSIGN_OR_RETURN(const FrameTimes frame, TimeFrame(foveated, settings, &buffers));
      warp.push_back(frame.smooth_warp_ms);
      WorkClock watch(threads);
      std::memset(picture.data(), round, picture.size() * sizeof(float));
      set_ms.push_back(watch.RestartMs());
      volatile const float* used = picture.data();  // so that memset stays
      (void)used[kSide];
    }
    std::printf("%5g %9.2f %12.2f %10.2f %7.1f\n", rate, Median(warp),
                Median(warp) * 1e6 / (kSide * kSide), Median(set_ms),
                Median(warp) / Median(set_ms));
  }
  return absl::OkStatus();
}

}  // namespace fovea::bench
