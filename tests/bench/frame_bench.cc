// Milliseconds of a frame, in one run, named workloads:
//   frame_bench [--workload NAME,NAME,...] [--rounds R] [--threads T]
//   frame_bench --raw FILE NX NY NZ [--rate RATE] [--rounds R] [--threads T]
// A workload is a volume of tests/bench/scenes.h and a rate, as bonsai25, brain25, colin27-40,
// bonsai512-40 or procedural512-40; or growth, rates, angles, widths, smoothing, memory or threads
// (what each measures is said in workloads.h). Renderers take turns; medians of the rounds, and
// ratios of the medians.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/renderer.h"
#include "tests/bench/frame_clock.h"
#include "tests/bench/scenes.h"
#include "tests/bench/workloads.h"

namespace fovea::bench {
namespace {

struct Options {
  std::vector<std::string> workloads;
  std::string raw;
  Int3 raw_dims;
  double raw_rate = 40;
  int rounds = 7;
  int threads = 1;
};

/// The frames of one volume, rate and transfer function.
struct Frames {
  std::vector<double> rebuild, rays, smooth_warp, total, full, plain;
  uint64_t samples = 0;
};

/// `whole`: every voxel as super-voxels, what full resolution is drawn from at our best.
Status MeasureFrames(const Volume& volume, CoefficientSource& source, const RetainedSet& retained,
                     const SuperVoxels& whole, const render::RenderSettings& settings, int rounds,
                     Frames* frames) {
  // Plain loops over 512^3 take seconds: a few rounds will do.
  const int plain_rounds = volume.dims.Max() > 256 ? std::min(rounds, 3) : rounds;
  Buffers buffers, full_buffers;
  SuperVoxels foveated;
  for (int round = 0; round < rounds; ++round) {
    FOVEA_ASSIGN_OR_RETURN(const double rebuild_ms,
                           TimeReconstruct(source, retained, settings.threads, &foveated));
    frames->rebuild.push_back(rebuild_ms);
    FOVEA_ASSIGN_OR_RETURN(const FrameTimes frame, TimeFrame(foveated, settings, &buffers));
    frames->total.push_back(frame.TotalMs());
    frames->rays.push_back(frame.rays_ms);
    frames->smooth_warp.push_back(frame.smooth_warp_ms);
    frames->samples = frame.samples;
    FOVEA_ASSIGN_OR_RETURN(const FrameTimes full, TimeFrame(whole, settings, &full_buffers));
    frames->full.push_back(full.TotalMs());
    WorkClock watch(settings.threads);
    if (round < plain_rounds) {
      FOVEA_ASSIGN_OR_RETURN(const render::Image plain,
                             render::RenderPlainLoops(volume.voxels, Matrix4{}, settings));
      frames->plain.push_back(watch.RestartMs());
    }
  }
  return absl::OkStatus();
}

Status RunVolume(const Volume& volume, double rate, const Options& options) {
  FOVEA_ASSIGN_OR_RETURN(const CoefficientSet set, Transform(volume));
  MemorySource source(set);
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(set.hierarchy, {volume.fovea, rate}));
  const SuperVoxels whole = WholeVolume(volume.voxels, volume.fovea, 0);
  for (const bool opaque : {false, true}) {
    const render::RenderSettings settings =
        SettingsFor(volume.dims, 30, TransferFor(volume.name, opaque), options.threads);
    Frames frames;
    FOVEA_RETURN_IF_ERROR(
        MeasureFrames(volume, source, retained, whole, settings, options.rounds, &frames));
    const double total = Median(frames.total);
    std::printf("%-14s %-6s %4g %9lld %9llu %8.2f %8.2f %8.2f %8.2f %9.1f %6.1f x %9.1f %6.1f x\n",
                volume.name.c_str(), opaque ? "opaque" : "semi", rate,
                static_cast<long long>(retained.CoefficientCount()),
                static_cast<unsigned long long>(frames.samples), Median(frames.rebuild),
                Median(frames.rays), Median(frames.smooth_warp), total, Median(frames.full),
                Median(frames.full) / total, Median(frames.plain), Median(frames.plain) / total);
    std::fflush(stdout);
  }
  return absl::OkStatus();
}

void PrintVolumeHeader() {
  std::printf("%-14s %-6s %4s %9s %9s %8s %8s %8s %8s %9s %8s %9s\n", "volume", "", "rate", "m",
              "samples", "rebuild", "rays", "smooth", "frame", "full", "", "plain");
}

/// The frame on one thread against two.
Status RunThreads(int rounds) {
  std::printf("threads: rays, smoothing and warp, medians in ms\n%-14s %4s %9s %9s %9s\n", "volume",
              "rate", "1 thread", "2", "ratio");
  for (const auto& [name, rate] : {std::pair("procedural256", 40.0), {"procedural512", 40.0}}) {
    FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume(name));
    FOVEA_ASSIGN_OR_RETURN(const CoefficientSet set, Transform(volume));
    MemorySource source(set);
    FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                           RetainedSet::Make(set.hierarchy, {volume.fovea, rate}));
    FOVEA_ASSIGN_OR_RETURN(const SuperVoxels foveated, Reconstruct(source, retained, 0));
    std::vector<double> times[2];
    Buffers buffers;
    for (int round = 0; round < rounds; ++round) {
      for (const int threads : {1, 2}) {
        const render::RenderSettings settings =
            SettingsFor(volume.dims, 30, TransferFor(volume.name, false), threads);
        const Stopwatch watch;  // the wall clock for both
        FOVEA_RETURN_IF_ERROR(TimeFrame(foveated, settings, &buffers).status());
        times[threads - 1].push_back(watch.ElapsedMs());
      }
    }
    std::printf("%-14s %4g %9.2f %9.2f %9.2f\n", name, rate, Median(times[0]), Median(times[1]),
                Median(times[0]) / Median(times[1]));
  }
  return absl::OkStatus();
}

/// "bonsai512-40" is bonsai512 at rate 40; without a dash the rate is the digits at the end.
Status RunNamed(const std::string& name, const Options& options) {
  if (name == "growth") {
    return RunGrowth(options.rounds, options.threads);
  }
  if (name == "smoothing") {
    return RunSmoothing(options.rounds, options.threads);
  }
  if (name == "rates") {
    return RunRates(options.rounds, options.threads);
  }
  if (name == "angles") {
    return RunAngles(options.rounds, options.threads);
  }
  if (name == "widths") {
    return RunWidths(options.rounds, options.threads);
  }
  if (name == "memory") {
    return RunMemory(options.threads);
  }
  if (name == "threads") {
    return RunThreads(options.rounds);
  }
  const size_t dash = name.rfind('-');
  const size_t digits = name.find_last_not_of("0123456789") + 1;
  const double rate = std::atof(name.substr(digits).c_str());
  FOVEA_ASSIGN_OR_RETURN(const Volume volume,
                         LoadVolume(name.substr(0, dash == std::string::npos ? digits : dash)));
  PrintVolumeHeader();
  return RunVolume(volume, rate, options);
}

Status Run(const Options& options) {
  if (!options.raw.empty()) {
    FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadRaw(options.raw, options.raw_dims));
    PrintVolumeHeader();
    return RunVolume(volume, options.raw_rate, options);
  }
  for (const std::string& name : options.workloads) {
    FOVEA_RETURN_IF_ERROR(RunNamed(name, options));
  }
  return absl::OkStatus();
}

int Usage() {
  std::fprintf(
      stderr,
      "usage: frame_bench [--workload NAME,... | --raw FILE NX NY NZ [--rate R]] "
      "[--rounds R] [--threads T]\n"
      "workloads: a volume and a rate (brain25, bonsai25, bonsai512-40, "
      "procedural512-40 ...), growth, rates, angles, widths, smoothing, memory, threads\n");
  return 2;
}

/// False if the command line is wrong.
bool Parse(const std::vector<std::string>& arguments, Options* options) {
  for (size_t i = 0; i + 1 < arguments.size(); i += 2) {
    const std::string& flag = arguments[i];
    const std::string& value = arguments[i + 1];
    if (flag == "--workload") {
      std::istringstream list(value);
      for (std::string name; std::getline(list, name, ',');) {
        options->workloads.push_back(name);
      }
    } else if (flag == "--raw" && i + 4 < arguments.size()) {
      options->raw = value;
      for (int axis = 0; axis < 3; ++axis) {
        options->raw_dims[axis] = std::atoll(arguments[i + 2 + axis].c_str());
      }
      i += 3;
    } else if (flag == "--rate") {
      options->raw_rate = std::atof(value.c_str());
    } else if (flag == "--rounds") {
      options->rounds = std::atoi(value.c_str());
    } else if (flag == "--threads") {
      options->threads = std::atoi(value.c_str());
    } else {
      return false;
    }
  }
  if (options->workloads.empty()) {
    options->workloads = {"procedural256-25", "procedural256-40"};
  }
  const bool pairs = (arguments.size() - (options->raw.empty() ? 0 : 3)) % 2 == 0;
  return pairs && options->rounds >= 1 && options->threads >= 0;
}

int Main(const std::vector<std::string>& arguments) {
  Options options;
  if (!Parse(arguments, &options)) {
    return Usage();
  }
  const Status status = Run(options);
  if (!status.ok()) {
    std::fprintf(stderr, "frame_bench: %s\n", std::string(MessageOf(status)).c_str());
  }
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace fovea::bench

int main(int argc, char** argv) {
  return fovea::bench::Main(std::vector<std::string>(argv + 1, argv + argc));
}
