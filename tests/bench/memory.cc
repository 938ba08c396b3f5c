// Counts what a frame allocates, by taking the place of operator new in this program.
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>

#include <malloc.h>

#include "engine/fovea/reconstruct.h"
#include "engine/render/frame_scratch.h"
#include "engine/render/renderer.h"
#include "tests/bench/scenes.h"
#include "tests/bench/separable_source.h"
#include "tests/bench/workloads.h"

namespace {

std::atomic<int64_t> calls{0}, bytes{0}, peak{0};

void* Counted(void* block) {
  if (block == nullptr) {
    throw std::bad_alloc();
  }
  const auto size = static_cast<int64_t>(malloc_usable_size(block));
  const int64_t now = bytes.fetch_add(size) + size;
  int64_t most = peak.load();
  while (now > most && !peak.compare_exchange_weak(most, now)) {
  }
  ++calls;
  return block;
}

void Uncounted(void* block) {
  if (block != nullptr) {
    bytes -= static_cast<int64_t>(malloc_usable_size(block));
    std::free(block);
  }
}

}  // namespace

void* operator new(size_t size) {
  return Counted(std::malloc(size));
}
void* operator new(size_t size, std::align_val_t alignment) {
  const auto unit = static_cast<size_t>(alignment);
  return Counted(std::aligned_alloc(unit, (size + unit - 1) / unit * unit));
}
void operator delete(void* block) noexcept {
  Uncounted(block);
}
void operator delete(void* block, size_t) noexcept {
  Uncounted(block);
}
void operator delete(void* block, std::align_val_t) noexcept {
  Uncounted(block);
}
void operator delete(void* block, size_t, std::align_val_t) noexcept {
  Uncounted(block);
}

namespace fovea::bench {
namespace {

Status MeasureFrame(const char* name, CoefficientSource& source, const Vec3& fovea, double rate,
                    const render::RenderSettings& settings) {
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(source.hierarchy(), {fovea, rate}));
  const int64_t before = bytes;
  FOVEA_ASSIGN_OR_RETURN(const SuperVoxels volume, Reconstruct(source, retained, settings.threads));
  const int64_t held = bytes - before;
  const int64_t picture = int64_t{16} * settings.width_px * settings.height_px;
  const int64_t scratch_before = bytes;
  render::FrameScratch scratch;
  render::Image image;
  int64_t frame_calls = 0, frame_peak = 0;
  for (int frame = 0; frame < 3; ++frame) {  // the last one counts: a steady state, if there is one
    const int64_t calls_before = calls;
    const int64_t bytes_before = bytes;
    peak = bytes_before;
    FOVEA_RETURN_IF_ERROR(render::RenderFoveated(volume, Matrix4{}, settings, &scratch, &image));
    frame_calls = calls - calls_before;
    frame_peak = peak - scratch_before;
  }
  const auto super_voxels = static_cast<double>(retained.SuperVoxelCount());
  std::printf("%-14s %4g %10.0f %10.2f %8.1f %12.2f %12.2f %8lld\n", name, rate, super_voxels,
              static_cast<double>(held) / 1e6, static_cast<double>(held) / super_voxels,
              static_cast<double>(picture) / 1e6, static_cast<double>(frame_peak - picture) / 1e6,
              static_cast<long long>(frame_calls));
  return absl::OkStatus();
}

}  // namespace

Status RunMemory(int threads) {
  std::printf("memory: held between frames, and allocated by a frame, MB\n");
  std::printf("%-14s %4s %10s %10s %8s %12s %12s %8s\n", "volume", "rate", "s.-voxels", "held",
              "B each", "the picture", "beside it", "calls");
  FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume("procedural256"));
  FOVEA_ASSIGN_OR_RETURN(const CoefficientSet set, Transform(volume));
  MemorySource source(set);
  const render::RenderSettings settings =
      SettingsFor(volume.dims, 30, TransferFor(volume.name, false), threads);
  for (const double rate : {25.0, 40.0, 100.0, 256.0}) {
    FOVEA_RETURN_IF_ERROR(MeasureFrame("procedural256", source, volume.fovea, rate, settings));
  }
  const Vec3 middle{2048, 2048, 2048};
  FOVEA_ASSIGN_OR_RETURN(SeparableSource large, MakeScaleFreeSource(4096, middle));
  for (const double rate : {25.0, 40.0}) {
    FOVEA_RETURN_IF_ERROR(MeasureFrame("blobs4096", large, middle, rate, settings));
  }
  return absl::OkStatus();
}

}  // namespace fovea::bench
