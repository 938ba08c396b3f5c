// `fovea bench`: what a frame of the user's own data costs, phase by phase, beside full resolution.
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/frame_scratch.h"
#include "engine/render/fused.h"
#include "engine/render/renderer.h"
#include "engine/store/dataset.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/values.h"
#include "service/frames/encode.h"
#include "service/frames/frames.h"
#include "service/frames/spec_json.h"

namespace fovea::cli {
namespace {

using nlohmann::json;
using Times = std::vector<double>;

double Median(Times times) {
  if (times.empty()) {
    return 0;
  }
  const auto middle = times.begin() + std::ssize(times) / 2;
  std::nth_element(times.begin(), middle, times.end());
  return *middle;
}

/// What one number of threads measured, a value a round, in milliseconds.
struct Measured {
  int threads = 1;
  render::FrameScratch scratch;  // as a viewer keeps it from frame to frame
  render::Image image;
  Times read, decode, reconstruct, rays, smooth_warp, frame, cold, fused, encode, full, plain;
};

/// Every voxel, where full resolution is to be measured.
struct FullResolution {
  Grid voxels;        // for the plain loops
  SuperVoxels whole;  // the same as super-voxels: skipping, early termination, SIMD
};

struct Bench {
  const BenchCommand& command;
  store::Dataset& dataset;
  store::DatasetInfo info;
  frames::FrameSpec spec;
  RetainedSet retained;
  uint64_t samples = 0;
  int64_t frame_peak_bytes = 0;
  std::optional<FullResolution> full;
  bool with_plain_loops = true, with_fused = true;
  std::vector<std::string> notes;  // what was left out, and why
};

int64_t PeakBytes() {
  struct rusage usage {};
  return ::getrusage(RUSAGE_SELF, &usage) == 0 ? int64_t{1024} * usage.ru_maxrss : 0;
}

/// Why full resolution is not measured; empty if it can be.
std::string WhyNotFull(const Int3& dims) {
  // Plain loops take about 10 ns a voxel, and voxels and super-voxels 4.6 bytes each.
  constexpr double kMostVoxels = 700e6;
  const auto voxels = static_cast<double>(dims.Product());
  const double have =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (voxels <= kMostVoxels && 10 * voxels <= 0.6 * have) {
    return "";
  }
  return fmt::format(
      "{}x{}x{} voxels are too many to draw at full resolution here ({:.1f} GB, about {:.0f} s a "
      "picture with plain loops): skipped",
      dims.x, dims.y, dims.z, 10 * voxels / 1e9, 10e-9 * voxels);
}

StatusOr<std::unique_ptr<store::StepSource>> OpenStep(const Bench& bench, int64_t step) {
  return bench.dataset.OpenStep(step, *bench.spec.field, store::OnDamage::kCount);
}

StatusOr<FullResolution> LoadFull(const Bench& bench) {
  FullResolution full;
  FOVEA_ASSIGN_OR_RETURN(const auto source, OpenStep(bench, bench.command.step));
  FOVEA_ASSIGN_OR_RETURN(full.voxels,
                         ExtractVoxels(*source, Box3::OfSize(bench.info.hierarchy.dims())));
  full.whole = WholeVolume(full.voxels, bench.spec.fovea->at, 0);
  return full;
}

/// One frame in two phases, as `fovea render` makes it.
Status MeasureFrame(Bench* bench, Measured* measured) {
  FOVEA_ASSIGN_OR_RETURN(const auto source, OpenStep(*bench, bench->command.step));
  ReconstructStats reconstructed;
  FOVEA_ASSIGN_OR_RETURN(const SuperVoxels volume,
                         Reconstruct(*source, bench->retained, measured->threads, &reconstructed));
  render::RenderStats rendered;
  Stopwatch watch;
  FOVEA_RETURN_IF_ERROR(render::RenderFoveated(
      volume, bench->info.index_to_world, frames::RenderSettingsOf(bench->spec, measured->threads),
      &measured->scratch, &measured->image, &rendered));
  measured->frame.push_back(watch.RestartMs());
  FOVEA_ASSIGN_OR_RETURN(
      const std::string pixels,
      frames::Encode(measured->image, bench->spec.encoding, *bench->spec.background,
                     static_cast<int>(*bench->spec.jpeg_quality)));
  measured->encode.push_back(watch.ElapsedMs());
  measured->read.push_back(reconstructed.read_ms);
  measured->decode.push_back(source->read_stats().decode_ms);
  measured->reconstruct.push_back(reconstructed.reconstruct_ms);
  measured->rays.push_back(rendered.render_ms);
  measured->smooth_warp.push_back(rendered.smooth_warp_ms);
  measured->cold.push_back(reconstructed.read_ms + reconstructed.reconstruct_ms +
                           measured->frame.back());
  bench->samples = rendered.samples;
  return absl::OkStatus();
}

/// Both phases at once, and playback that way: a step on each thread, one after the other.
Status MeasureFused(const Bench& bench, Measured* measured) {
  const render::RenderSettings settings = frames::RenderSettingsOf(bench.spec, 1);
  std::vector<Status> results(static_cast<size_t>(2 * measured->threads));
  const Stopwatch watch;
  ParallelFor(0, std::ssize(results), 1, measured->threads, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const auto source = OpenStep(bench, (bench.command.step + i) % bench.info.committed_steps);
      results[static_cast<size_t>(i)] =
          source.ok()
              ? render::RenderFused(**source, bench.retained, bench.info.index_to_world, settings)
                    .status()
              : source.status();
    }
  });
  measured->fused.push_back(watch.ElapsedMs() / static_cast<double>(results.size()));
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return absl::OkStatus();
}

Status MeasureFull(const Bench& bench, Measured* measured) {
  const render::RenderSettings settings = frames::RenderSettingsOf(bench.spec, measured->threads);
  Stopwatch watch;
  FOVEA_RETURN_IF_ERROR(render::RenderFoveated(bench.full->whole, bench.info.index_to_world,
                                               settings, &measured->scratch, &measured->image));
  measured->full.push_back(watch.RestartMs());
  if (bench.with_plain_loops) {
    FOVEA_ASSIGN_OR_RETURN(
        const render::Image plain,
        render::RenderPlainLoops(bench.full->voxels, bench.info.index_to_world, settings));
    measured->plain.push_back(watch.RestartMs());
  }
  return absl::OkStatus();
}

/// What this dataset and picture can be compared with; the rest is noted.
Status ChooseComparisons(Bench* bench) {
  const render::RenderSettings settings = frames::RenderSettingsOf(bench->spec, 1);
  Measured trial;
  const Status fused = settings.perspective
                           ? FailedPrecondition("perspective views are rendered in two phases")
                           : MeasureFused(*bench, &trial);
  if (absl::IsFailedPrecondition(fused)) {
    bench->with_fused = false;
    bench->notes.push_back("fused: " + std::string(MessageOf(fused)));
  } else {
    FOVEA_RETURN_IF_ERROR(fused);
  }
  const std::string too_large = WhyNotFull(bench->info.hierarchy.dims());
  if (!too_large.empty()) {
    bench->notes.push_back(too_large);
    return absl::OkStatus();
  }
  if (settings.perspective || settings.weighting.kind != render::Weighting::Kind::kNone ||
      !settings.clip.IsEmpty() || settings.lighting.enabled ||
      settings.compositing != render::Compositing::kEmissionAbsorption) {
    bench->with_plain_loops = false;
    bench->notes.emplace_back(
        "plain loops know no perspective, weighting, clipping, lighting or maxima: not measured");
  }
  FOVEA_ASSIGN_OR_RETURN(bench->full, LoadFull(*bench));
  return absl::OkStatus();
}

/// Everything takes turns, so that a busy machine slows all alike.
Status MeasureRounds(Bench* bench, std::vector<Measured>* measured) {
  // Full resolution of a large volume takes seconds: three rounds of it must do.
  const bool slow = bench->info.hierarchy.dims().Product() > 30'000'000;
  Progress progress(bench->command.output, "bench", "rounds");
  for (int round = 0; round < bench->command.rounds; ++round) {
    progress.Update(round, bench->command.rounds);
    for (Measured& one : *measured) {
      if (Interrupted()) {
        return Cancelled("stopped in round {} of {}", round + 1, bench->command.rounds);
      }
      FOVEA_RETURN_IF_ERROR(MeasureFrame(bench, &one));
      if (bench->with_fused) {
        FOVEA_RETURN_IF_ERROR(MeasureFused(*bench, &one));
      }
      if (bench->full && (!slow || round < 3)) {
        FOVEA_RETURN_IF_ERROR(MeasureFull(*bench, &one));
      }
    }
  }
  return absl::OkStatus();
}

/// A row of the table: a phase, and how to find its median.
struct Phase {
  const char* key;    // in JSON
  const char* label;  // in the table
  Times Measured::*times;
};

constexpr Phase kPhases[] = {
    {"read_ms", "read (on all threads)", &Measured::read},
    {"decode_ms", "  of that decoding, summed", &Measured::decode},
    {"reconstruct_ms", "reconstruct", &Measured::reconstruct},
    {"rays_combine_ms", "thick rays, combine", &Measured::rays},
    {"smooth_warp_ms", "smooth, warp", &Measured::smooth_warp},
    {"encode_ms", "encode (PNG)", &Measured::encode},
    {"frame_ms", "frame (rays to warp)", &Measured::frame},
    {"two_phase_ms", "frame of a new step, two phases", &Measured::cold},
    {"fused_playback_ms", "the same fused, a step a thread", &Measured::fused},
    {"full_ms", "full resolution, skipping", &Measured::full},
    {"plain_loops_ms", "full resolution, plain loops", &Measured::plain},
};

void PrintTable(const Bench& bench, const std::vector<Measured>& measured) {
  const Int3& dims = bench.info.hierarchy.dims();
  PrintLine(fmt::format("{}: {}x{}x{} voxels, step {}, field {}", bench.command.dataset, dims.x,
                        dims.y, dims.z, bench.command.step, *bench.spec.field));
  PrintLine("pinned by: " + PinningFlags(bench.spec, dims));
  PrintLine(fmt::format("m {} coefficients, {} super-voxels, {} samples; peak memory of a frame {}",
                        bench.retained.CoefficientCount(), bench.retained.SuperVoxelCount(),
                        bench.samples, HumanBytes(static_cast<uint64_t>(bench.frame_peak_bytes))));
  std::string head =
      fmt::format("{:<32}", fmt::format("medians of {} rounds, ms", bench.command.rounds));
  for (const Measured& one : measured) {
    head += fmt::format("{:>22}", one.threads == 1 ? std::string("1 thread")
                                                   : fmt::format("{} threads", one.threads));
  }
  PrintLine(head);
  for (const Phase& phase : kPhases) {
    if ((measured.front().*phase.times).empty()) {
      continue;
    }
    std::string line = fmt::format("{:<32}", phase.label);
    const bool compared = phase.times == &Measured::full || phase.times == &Measured::plain;
    for (const Measured& one : measured) {
      const double ms = Median(one.*phase.times);
      const std::string times = compared ? fmt::format(" ({:.1f} x)", ms / Median(one.frame)) : "";
      line += fmt::format("{:>12.2f}{:<10}", ms, times);
    }
    PrintLine(line);
  }
  std::string line = fmt::format("{:<32}", "ns a sample, rays and combine");
  for (const Measured& one : measured) {
    line += fmt::format(
        "{:>12.2f}{:<10}",
        Median(one.rays) * 1e6 / static_cast<double>(std::max<uint64_t>(bench.samples, 1)), "");
  }
  PrintLine(line);
}

void PrintAsJson(const Bench& bench, const std::vector<Measured>& measured) {
  const Int3& dims = bench.info.hierarchy.dims();
  json value = {{"dataset", bench.command.dataset},
                {"dims_xyz", {dims.x, dims.y, dims.z}},
                {"step", bench.command.step},
                {"spec", frames::SpecToJson(bench.spec)},
                {"flags", PinningFlags(bench.spec, dims)},
                {"rounds", bench.command.rounds},
                {"coefficients", bench.retained.CoefficientCount()},
                {"super_voxels", bench.retained.SuperVoxelCount()},
                {"samples", bench.samples},
                {"frame_peak_bytes", bench.frame_peak_bytes},
                {"runs", json::array()}};
  for (const Measured& one : measured) {
    json run = {{"threads", one.threads}};
    for (const Phase& phase : kPhases) {
      if (!(one.*phase.times).empty()) {
        run[phase.key] = Median(one.*phase.times);
      }
    }
    run["ns_per_sample"] =
        Median(one.rays) * 1e6 / static_cast<double>(std::max<uint64_t>(bench.samples, 1));
    value["runs"].push_back(run);
  }
  value["notes"] = bench.notes;
  PrintJson(value);
}

}  // namespace

Status Run(const BenchCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(command.dataset));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, frames::DefaultSpec(*dataset));
  Bench bench{command, *dataset, dataset->info(), {}, {}, 0, 0, {}, true, true, {}};
  FOVEA_ASSIGN_OR_RETURN(bench.spec, frames::ResolveSpec(*dataset, command.spec, defaults));
  FOVEA_ASSIGN_OR_RETURN(bench.retained,
                         RetainedSet::Make(bench.info.hierarchy, frames::FoveaOf(bench.spec)));
  std::vector<Measured> measured(1);
  const int other = command.threads > 0 ? command.threads : HardwareThreads();
  if (other > 1) {
    measured.emplace_back().threads = other;
  }
  Measured warm_up;
  warm_up.threads = other;
  FOVEA_RETURN_IF_ERROR(MeasureFrame(&bench, &warm_up));
  bench.frame_peak_bytes = PeakBytes();
  FOVEA_RETURN_IF_ERROR(ChooseComparisons(&bench));
  FOVEA_RETURN_IF_ERROR(MeasureRounds(&bench, &measured));
  for (const std::string& note : bench.notes) {
    Note(command.output, "note: " + note);
  }
  command.output.json ? PrintAsJson(bench, measured) : PrintTable(bench, measured);
  return absl::OkStatus();
}

}  // namespace fovea::cli
