// The three curves of Yu et al., Figure 7, as tables that paper_figures.py draws.
#include <array>
#include <cstdio>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/render/renderer.h"
#include "tests/bench/frame_clock.h"
#include "tests/bench/scenes.h"
#include "tests/bench/separable_source.h"
#include "tests/bench/workloads.h"

namespace fovea::bench {
namespace {

/// Reconstruction, rays, smoothing and warp of one frame. The paper's two phases are one, so the
/// time to reconstruct is part of a frame here.
Status AddFrame(CoefficientSource& source, const RetainedSet& retained,
                const render::RenderSettings& settings, Buffers* buffers,
                std::vector<double>* frames) {
  SuperVoxels volume;
  FOVEA_ASSIGN_OR_RETURN(const double rebuild_ms,
                         TimeReconstruct(source, retained, settings.threads, &volume));
  FOVEA_ASSIGN_OR_RETURN(const FrameTimes frame, TimeFrame(volume, settings, buffers));
  frames->push_back(rebuild_ms + frame.TotalMs());
  return absl::OkStatus();
}

/// Frames of bonsai512 at the rates and angles given, in turns: [rate][angle].
Status MeasureBonsai(const std::vector<double>& rates, const std::vector<double>& angles,
                     int rounds, int threads) {
  FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume("bonsai512"));
  FOVEA_ASSIGN_OR_RETURN(const CoefficientSet set, Transform(volume));
  MemorySource source(set);
  std::vector<std::vector<double>> frames(rates.size() * angles.size());
  std::vector<int64_t> m(rates.size());
  Buffers buffers;
  for (int round = 0; round < rounds; ++round) {
    for (size_t r = 0; r < rates.size(); ++r) {
      FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                             RetainedSet::Make(set.hierarchy, {volume.fovea, rates[r]}));
      m[r] = retained.CoefficientCount();
      for (size_t a = 0; a < angles.size(); ++a) {
        const render::RenderSettings settings =
            SettingsFor(volume.dims, angles[a], TransferFor(volume.name, false), threads);
        FOVEA_RETURN_IF_ERROR(
            AddFrame(source, retained, settings, &buffers, &frames[r * angles.size() + a]));
      }
    }
  }
  std::printf("%6s %9s %8s %9s\n", "rate", "m", "degrees", "frame ms");
  for (size_t r = 0; r < rates.size(); ++r) {
    for (size_t a = 0; a < angles.size(); ++a) {
      std::printf("%6g %9lld %8g %9.2f\n", rates[r], static_cast<long long>(m[r]), angles[a],
                  Median(frames[r * angles.size() + a]));
    }
  }
  return absl::OkStatus();
}

}  // namespace

Status RunRates(int rounds, int threads) {
  return MeasureBonsai({10, 20, 30, 40, 50, 60, 70, 80, 90, 100}, {0, 45}, rounds, threads);
}

Status RunAngles(int rounds, int threads) {
  return MeasureBonsai({40}, {0, 5, 10, 15, 20, 25, 30, 35, 40, 45}, rounds, threads);
}

Status RunWidths(int rounds, int threads) {
  constexpr std::array<int64_t, 5> kSizes = {256, 512, 1024, 2048, 4096};
  constexpr std::array<double, 2> kAngles = {0, 45};
  std::vector<double> frames[5][2][2];  // [size][angle][picture n x n, 512 x 512]
  std::array<int64_t, 5> m{};
  Buffers buffers;
  for (int round = 0; round < rounds; ++round) {
    for (size_t i = 0; i < kSizes.size(); ++i) {
      const auto middle = 0.5 * static_cast<double>(kSizes[i]);
      const Vec3 fovea{middle, middle, middle};
      FOVEA_ASSIGN_OR_RETURN(SeparableSource source, MakeScaleFreeSource(kSizes[i], fovea));
      FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                             RetainedSet::Make(source.hierarchy(), {fovea, 40}));
      m[i] = retained.CoefficientCount();
      for (size_t a = 0; a < kAngles.size(); ++a) {
        for (const bool fixed : {false, true}) {
          render::RenderSettings settings = ScaleFreeSettings(kSizes[i], kAngles[a], threads);
          if (fixed) {
            settings.width_px = settings.height_px = 512;
          }
          FOVEA_RETURN_IF_ERROR(
              AddFrame(source, retained, settings, &buffers, &frames[i][a][fixed]));
        }
      }
    }
  }
  std::printf("%6s %9s %8s %12s %12s\n", "n", "m", "degrees", "n x n ms", "512 x 512 ms");
  for (size_t i = 0; i < kSizes.size(); ++i) {
    for (size_t a = 0; a < kAngles.size(); ++a) {
      std::printf("%6lld %9lld %8g %12.2f %12.2f\n", static_cast<long long>(kSizes[i]),
                  static_cast<long long>(m[i]), kAngles[a], Median(frames[i][a][0]),
                  Median(frames[i][a][1]));
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::bench
