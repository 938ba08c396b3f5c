#ifndef TESTS_BENCH_FRAME_CLOCK_H_
#define TESTS_BENCH_FRAME_CLOCK_H_

#include <cstdint>
#include <ctime>

#include "engine/fovea/reconstruct.h"
#include "engine/render/expand.h"
#include "engine/render/frame_scratch.h"
#include "engine/render/renderer.h"

/// Time that means the same on a busy machine.
namespace fovea::bench {

/// Milliseconds of this process's own work if one thread works, so that other programs do not
/// count; of the wall clock with more threads.
class WorkClock {
 public:
  explicit WorkClock(int threads)
      : clock_(threads == 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC), start_(Now()) {}
  double RestartMs() {
    const double now = Now();
    const double elapsed = now - start_;
    start_ = now;
    return elapsed;
  }

 private:
  [[nodiscard]] double Now() const {
    timespec time{};
    ::clock_gettime(clock_, &time);
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
  }

  clockid_t clock_;
  double start_;
};

/// What frames share, as a viewer's do.
struct Buffers {
  render::FrameScratch scratch;
  render::Image image;
};

struct FrameTimes {
  double rays_ms = 0, smooth_warp_ms = 0;
  uint64_t samples = 0;
  [[nodiscard]] double TotalMs() const { return rays_ms + smooth_warp_ms; }
};

/// One frame into buffers->image: RenderFoveated, timed in its two parts.
inline StatusOr<FrameTimes> TimeFrame(const SuperVoxels& volume,
                                      const render::RenderSettings& settings, Buffers* buffers) {
  WorkClock clock(settings.threads);
  FrameTimes times;
  render::RenderStats stats;
  FOVEA_RETURN_IF_ERROR(
      render::RenderFrame(volume, Matrix4{}, settings, &buffers->scratch, &stats));
  times.rays_ms = clock.RestartMs();
  render::Expand(buffers->scratch.frame, settings.width_px, settings.height_px, settings.smoothing,
                 settings.basis, settings.threads, &buffers->scratch.expand, &buffers->image);
  times.smooth_warp_ms = clock.RestartMs();
  times.samples = stats.samples;
  return times;
}

/// Reconstructs into `volume`, in its memory; milliseconds without the time in the source, which
/// benchmarks make up.
inline StatusOr<double> TimeReconstruct(CoefficientSource& source, const RetainedSet& retained,
                                        int threads, SuperVoxels* volume) {
  WorkClock clock(threads);
  ReconstructStats stats;
  FOVEA_RETURN_IF_ERROR(
      ReconstructInto(source, retained, threads, Reconstruction::kExact, volume, &stats));
  const double all_ms = clock.RestartMs();
  const double wall_ms = stats.read_ms + stats.reconstruct_ms;
  return wall_ms > 0 ? all_ms * stats.reconstruct_ms / wall_ms : all_ms;
}

}  // namespace fovea::bench

#endif  // TESTS_BENCH_FRAME_CLOCK_H_
