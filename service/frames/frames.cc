#include "service/frames/frames.h"

#include <unistd.h>

#include <array>
#include <memory>
#include <optional>
#include <utility>

#include "engine/base/stopwatch.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/fused.h"
#include "engine/render/perspective.h"
#include "engine/store/retention.h"
#include "service/frames/foveated_codec.h"
#include "service/frames/foveated_picture.h"

namespace fovea::frames {
namespace {

/// Refuses what this machine could not hold anyway, before anything is read.
Status CheckMemory(const store::DatasetInfo& info, const RetainedSet& retained,
                   const FrameSpec& resolved) {
  // An encoder holds the picture's bytes, and its own.
  constexpr double kEncodedBytesPerPixel = 12;
  const double need =
      FrameBytes(info, retained, resolved) +
      kEncodedBytesPerPixel * static_cast<double>(*resolved.width_px * *resolved.height_px);
  const double have =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (need > have) {
    return ResourceExhausted(
        "rate {} and a picture of {}x{} need about {:.1f} GB of memory, this machine has {:.1f}; "
        "ask for a lower rate or a smaller picture",
        FormatRate(*resolved.rate), *resolved.width_px, *resolved.height_px, need / 1e9,
        have / 1e9);
  }
  return absl::OkStatus();
}

/// Where the picture shows a point; nothing if it is behind the camera.
std::optional<std::array<double, 2>> PixelOf(const Vec3& point,
                                             const render::RenderSettings& settings,
                                             const store::DatasetInfo& info) {
  if (settings.perspective) {
    return render::ProjectToPixel(*settings.perspective, info.index_to_world, settings.width_px,
                                  settings.height_px, point);
  }
  return render::ProjectToPixel(settings.view, info.hierarchy.dims(), info.index_to_world,
                                settings.width_px, settings.height_px, point);
}

/// The fields of one step that a frame shows.
struct Sources {
  std::unique_ptr<store::StepSource> value;
  std::unique_ptr<store::StepSource> color;  // may be null
};

StatusOr<Sources> OpenSources(store::Dataset& dataset, int64_t step, const FrameSpec& resolved) {
  const auto on_damage = resolved.strict ? store::OnDamage::kFail : store::OnDamage::kCount;
  Sources sources;
  FOVEA_ASSIGN_OR_RETURN(sources.value, dataset.OpenStep(step, *resolved.field, on_damage));
  if (resolved.color_field) {
    FOVEA_ASSIGN_OR_RETURN(sources.color, dataset.OpenStep(step, *resolved.color_field, on_damage));
  }
  return sources;
}

/// The volumes that a two-phase frame shows.
struct Volumes {
  const SuperVoxels* value = nullptr;
  const SuperVoxels* color = nullptr;  // may be null
};

StatusOr<FoveatedPicture> RenderVolumes(const Volumes& volumes, const Matrix4& index_to_world,
                                        const render::RenderSettings& settings, FrameStats* stats) {
  render::RenderStats rendered;
  FoveatedPicture picture;
  if (settings.perspective) {
    FOVEA_RETURN_IF_ERROR(render::Validate(settings));
    FOVEA_ASSIGN_OR_RETURN(
        picture.frame, render::RenderPerspectiveFrame(*volumes.value, volumes.color, index_to_world,
                                                      settings, &rendered));
  } else {
    FOVEA_ASSIGN_OR_RETURN(picture.frame, render::RenderFrame(*volumes.value, index_to_world,
                                                              settings, &rendered, volumes.color));
  }
  stats->samples = rendered.samples;
  stats->render_ms = rendered.render_ms;
  return picture;
}

StatusOr<FoveatedPicture> RenderTwoPhase(const FrameCoefficients& sources,
                                         const RetainedSet& retained, const Matrix4& index_to_world,
                                         const render::RenderSettings& settings, Reconstruction how,
                                         FrameStats* stats) {
  ReconstructStats times;
  FOVEA_ASSIGN_OR_RETURN(const SuperVoxels volume,
                         Reconstruct(*sources.value, retained, settings.threads, &times, how));
  SuperVoxels colors;
  if (sources.color != nullptr) {
    ReconstructStats more;
    FOVEA_ASSIGN_OR_RETURN(colors,
                           Reconstruct(*sources.color, retained, settings.threads, &more, how));
    times.read_ms += more.read_ms;
    times.reconstruct_ms += more.reconstruct_ms;
  }
  stats->read_ms = times.read_ms;
  stats->reconstruct_ms = times.reconstruct_ms;
  return RenderVolumes({&volume, sources.color != nullptr ? &colors : nullptr}, index_to_world,
                       settings, stats);
}

StatusOr<FoveatedPicture> RenderFused(const FrameCoefficients& sources, const RetainedSet& retained,
                                      const Matrix4& index_to_world,
                                      const render::RenderSettings& settings, FrameStats* stats) {
  render::FusedStats fused;
  FoveatedPicture picture;
  FOVEA_ASSIGN_OR_RETURN(
      picture.frame, render::RenderFusedFrame(*sources.value, retained, index_to_world, settings,
                                              &fused, sources.color));
  stats->samples = fused.samples;
  stats->read_ms = fused.read_ms;
  stats->reconstruct_ms = fused.reconstruct_ms;
  stats->render_ms = fused.total_ms - fused.read_ms - fused.reconstruct_ms;
  return picture;
}

/// `picture` to the bytes of the encoding asked for.
StatusOr<std::string> EncodePicture(FoveatedPicture picture, const FrameSpec& resolved, int threads,
                                    FrameStats* stats) {
  Stopwatch watch;
  if (resolved.encoding == Encoding::kFoveated) {
    auto bytes = EncodeFoveated(picture);
    stats->encode_ms = watch.ElapsedMs();
    return bytes;
  }
  if (resolved.encoding != Encoding::kRawRgbaF32) {
    SnapLeaves(&picture, threads);
  }
  const std::optional<Marker> marker = picture.marker;
  render::Image image = ExpandImage(std::move(picture), threads);
  stats->smooth_warp_ms = watch.RestartMs();
  auto bytes = EncodeMarked(std::move(image), marker, resolved.encoding, *resolved.background,
                            static_cast<int>(*resolved.jpeg_quality));
  stats->encode_ms = watch.ElapsedMs();
  return bytes;
}

void AddReadStats(const store::ReadStats& read, const std::string& field, Frame* frame) {
  frame->stats.chunks_read += read.chunks_read;
  frame->stats.chunks_total += read.chunks_total;
  frame->stats.bytes_read += read.bytes_read;
  if (std::optional<Warning> warning = DamageWarning(read, field, frame->step)) {
    frame->warnings.push_back(*std::move(warning));
  }
}

/// The coefficients that a frame keeps, once it is known that this machine can hold it.
StatusOr<RetainedSet> PrepareRetained(const store::DatasetInfo& info, const FrameSpec& resolved) {
  FOVEA_ASSIGN_OR_RETURN(RetainedSet retained,
                         RetainedSet::Make(info.hierarchy, FoveaOf(resolved)));
  FOVEA_RETURN_IF_ERROR(CheckMemory(info, retained, resolved));
  return retained;
}

/// From the pyramid to the bytes.
StatusOr<Frame> FinishFrame(FoveatedPicture picture, const store::DatasetInfo& info,
                            const RetainedSet& retained, const FrameSpec& resolved,
                            const render::RenderSettings& settings, const FrameStats& stats) {
  Frame frame;
  frame.used = resolved;
  frame.encoding = resolved.encoding;
  frame.stats = stats;
  if (std::optional<Warning> warning = RetentionWarning(info, retained)) {
    frame.warnings.push_back(*std::move(warning));
  }
  picture.smoothing = settings.smoothing;
  picture.basis = settings.basis;
  picture.background = *resolved.background;
  if (resolved.fovea_marker) {
    picture.marker = PixelOf(resolved.fovea->at, settings, info);
  }
  FOVEA_ASSIGN_OR_RETURN(
      frame.pixels, EncodePicture(std::move(picture), resolved, settings.threads, &frame.stats));
  frame.width_px = settings.width_px;
  frame.height_px = settings.height_px;
  const uint64_t fields = resolved.color_field ? 2 : 1;
  frame.stats.coefficients = fields * static_cast<uint64_t>(retained.CoefficientCount());
  frame.stats.super_voxels = fields * static_cast<uint64_t>(retained.SuperVoxelCount());
  return frame;
}

StatusOr<Frame> RenderUnshared(store::Dataset& dataset, int64_t step, const FrameSpec& resolved,
                               int threads) {
  FOVEA_ASSIGN_OR_RETURN(const Sources sources, OpenSources(dataset, step, resolved));
  FOVEA_ASSIGN_OR_RETURN(Frame frame, RenderCoefficients({sources.value.get(), sources.color.get()},
                                                         dataset.info(), resolved, threads));
  frame.step = step;
  AddReadStats(sources.value->read_stats(), *resolved.field, &frame);
  if (sources.color != nullptr) {
    AddReadStats(sources.color->read_stats(), *resolved.color_field, &frame);
  }
  return frame;
}

/// The volume of one field, from the cache or read now; what it cost this frame goes to `stats`.
StatusOr<VolumeCache::Found> FindVolume(store::Dataset& dataset, int64_t step,
                                        const std::string& field, const RetainedSet& retained,
                                        const FrameSpec& resolved, int threads,
                                        const SharedVolumes& shared, FrameStats* stats) {
  const auto make = [&]() -> StatusOr<ReadVolume> {
    const auto on_damage = resolved.strict ? store::OnDamage::kFail : store::OnDamage::kCount;
    FOVEA_ASSIGN_OR_RETURN(const auto source, dataset.OpenStep(step, field, on_damage));
    ReadVolume read;
    FOVEA_ASSIGN_OR_RETURN(read.volume,
                           Reconstruct(*source, retained, threads, &read.times,
                                       resolved.reconstruction.value_or(Reconstruction::kExact)));
    read.read = source->read_stats();
    return read;
  };
  FOVEA_ASSIGN_OR_RETURN(VolumeCache::Found found,
                         shared.cache->Get(VolumeKey(shared.dataset, step, field, resolved), make));
  if (!found.hit) {
    stats->read_ms += found.volume->times.read_ms;
    stats->reconstruct_ms += found.volume->times.reconstruct_ms;
  }
  return found;
}

void AddFoundStats(const VolumeCache::Found& found, const std::string& field, Frame* frame) {
  store::ReadStats read = found.volume->read;
  if (found.hit) {
    read.chunks_read = read.bytes_read = 0;
  }
  AddReadStats(read, field, frame);
}

StatusOr<Frame> RenderShared(store::Dataset& dataset, int64_t step, const FrameSpec& resolved,
                             int threads, const SharedVolumes& shared) {
  const store::DatasetInfo info = dataset.info();
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained, PrepareRetained(info, resolved));
  const render::RenderSettings settings = RenderSettingsOf(resolved, threads);
  FrameStats stats;
  const auto find = [&](const std::string& field) {
    return FindVolume(dataset, step, field, retained, resolved, threads, shared, &stats);
  };
  FOVEA_ASSIGN_OR_RETURN(const VolumeCache::Found value, find(*resolved.field));
  VolumeCache::Found color;
  if (resolved.color_field) {
    FOVEA_ASSIGN_OR_RETURN(color, find(*resolved.color_field));
  }
  const Volumes volumes{&value.volume->volume, color.volume ? &color.volume->volume : nullptr};
  FOVEA_ASSIGN_OR_RETURN(FoveatedPicture picture,
                         RenderVolumes(volumes, info.index_to_world, settings, &stats));
  FOVEA_ASSIGN_OR_RETURN(
      Frame frame, FinishFrame(std::move(picture), info, retained, resolved, settings, stats));
  frame.step = step;
  AddFoundStats(value, *resolved.field, &frame);
  if (color.volume) {
    AddFoundStats(color, *resolved.color_field, &frame);
  }
  return frame;
}

}  // namespace

std::optional<Warning> DamageWarning(const store::ReadStats& read, const std::string& field,
                                     int64_t step) {
  if (read.chunks_damaged == 0) {
    return std::nullopt;
  }
  return Warning{
      fmt::format("{} damaged chunks of '{}' at step {} were left out: coarser values show "
                  "there; `fovea verify` lists them",
                  read.chunks_damaged, field, step),
      read.chunks_damaged};
}

std::optional<Warning> RetentionWarning(const store::DatasetInfo& info,
                                        const RetainedSet& retained) {
  const StatusOr<store::RetainedChunks> kept = store::RetainedChunks::Make(info);
  if (!kept.ok() || kept->Covers(retained)) {
    return std::nullopt;
  }
  return Warning{
      "the fovea's window reaches outside what the dataset retains: coarser values show "
      "there; `fovea info` lists its windows",
      0, Warning::Code::kNotRetained};
}

render::RenderSettings RenderSettingsOf(const FrameSpec& resolved, int threads) {
  render::RenderSettings settings;
  if (const auto& camera = resolved.view.perspective) {
    settings.perspective = {camera->eye.at, camera->target->at, camera->up, *camera->fov_y_deg};
  } else {
    settings.view = {*resolved.view.azimuth_deg, *resolved.view.elevation_deg,
                     resolved.view.center->at, resolved.view.span_voxels};
  }
  settings.transfer = *resolved.transfer;
  settings.weighting = *resolved.weighting;
  settings.smoothing = *resolved.smoothing;
  settings.basis = resolved.basis.value_or(render::Basis::kBilinear);
  settings.compositing = resolved.compositing.value_or(render::Compositing::kEmissionAbsorption);
  settings.lighting = resolved.lighting.value_or(render::Lighting{});
  settings.clip = EngineClip(resolved.clip);
  settings.color_transfer = resolved.color_transfer.value_or(render::TransferFunction{});
  settings.width_px = static_cast<int>(*resolved.width_px);
  settings.height_px = static_cast<int>(*resolved.height_px);
  settings.threads = threads;
  return settings;
}

double FrameBytes(const store::DatasetInfo& info, const RetainedSet& retained,
                  const FrameSpec& resolved) {
  // Measured: 9 bytes a coefficient, 16 a pixel.
  const double field_bytes = 10.0 * static_cast<double>(retained.CoefficientCount());
  const double second_field_bytes = resolved.color_field ? field_bytes : 0;
  if (!resolved.view.perspective) {
    return second_field_bytes +
           static_cast<double>(CountFrame(info, retained, resolved).memory_bytes);
  }
  const render::RenderSettings settings = RenderSettingsOf(resolved, 0);
  return field_bytes + second_field_bytes +
         16.0 * static_cast<double>(*resolved.width_px * *resolved.height_px) +
         render::PerspectiveBytes(retained, *settings.perspective, info.index_to_world,
                                  settings.width_px, settings.height_px);
}

int64_t MostFoveatedBytes(const store::DatasetInfo& info, const RetainedSet& retained,
                          const FrameSpec& resolved) {
  if (!resolved.view.perspective) {
    return MostFoveatedBytes(CountFrame(info, retained, resolved).accumulator_pixels);
  }
  const render::RenderSettings settings = RenderSettingsOf(resolved, 0);
  return MostFoveatedBytes(render::PerspectivePixels(
      retained, *settings.perspective, info.index_to_world, settings.width_px, settings.height_px));
}

render::FrameCounts CountFrame(const store::DatasetInfo& info, const RetainedSet& retained,
                               const FrameSpec& resolved) {
  const render::RenderSettings settings = RenderSettingsOf(resolved, 1);
  const render::ShearView view =
      render::FactorView(settings.view, info.hierarchy.dims(), info.index_to_world,
                         settings.width_px, settings.height_px);
  return render::CountFrame(retained, view, settings.width_px, settings.height_px);
}

StatusOr<Frame> RenderCoefficients(const FrameCoefficients& coefficients,
                                   const store::DatasetInfo& info, const FrameSpec& resolved,
                                   int threads) {
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained, PrepareRetained(info, resolved));
  const render::RenderSettings settings = RenderSettingsOf(resolved, threads);
  FrameStats stats;
  FOVEA_ASSIGN_OR_RETURN(
      FoveatedPicture picture,
      resolved.mode == Mode::kFused
          ? RenderFused(coefficients, retained, info.index_to_world, settings, &stats)
          : RenderTwoPhase(coefficients, retained, info.index_to_world, settings,
                           resolved.reconstruction.value_or(Reconstruction::kExact), &stats));
  return FinishFrame(std::move(picture), info, retained, resolved, settings, stats);
}

StatusOr<Frame> RenderFrame(store::Dataset& dataset, const std::string& dataset_name, int64_t step,
                            const FrameSpec& resolved, int threads, const SharedVolumes& shared) {
  FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset.TimeNs(step));
  FOVEA_ASSIGN_OR_RETURN(const std::optional<int64_t> frame_number, dataset.FrameNumber(step));
  const bool two_phase = resolved.mode != Mode::kFused;
  FOVEA_ASSIGN_OR_RETURN(Frame frame, two_phase && shared.cache != nullptr
                                          ? RenderShared(dataset, step, resolved, threads, shared)
                                          : RenderUnshared(dataset, step, resolved, threads));
  frame.dataset = dataset_name;
  frame.step = step;
  frame.time_ns = time_ns;
  frame.frame_number = frame_number;
  return frame;
}

StatusOr<int64_t> StepAtTime(store::Dataset& dataset, int64_t time_ns) {
  const int64_t committed = dataset.info().committed_steps;
  if (committed == 0) {
    return OutOfRange("time_ns {}: the dataset has no committed step yet", time_ns);
  }
  FOVEA_ASSIGN_OR_RETURN(const int64_t first_ns, dataset.TimeNs(0));
  if (time_ns < first_ns) {
    return OutOfRange("time_ns {} is before the first step, which is at {} ns", time_ns, first_ns);
  }
  // Invariant: low is not after time_ns, high is (or does not exist).
  int64_t low = 0;
  int64_t high = committed;
  while (high - low > 1) {
    const int64_t middle = low + (high - low) / 2;
    FOVEA_ASSIGN_OR_RETURN(const int64_t middle_ns, dataset.TimeNs(middle));
    (middle_ns <= time_ns ? low : high) = middle;
  }
  return low;
}

}  // namespace fovea::frames
