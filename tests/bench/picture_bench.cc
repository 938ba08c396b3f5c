// What a picture costs after the thick rays, one thread unless said, in one run:
//   picture_bench [--raw FILE NX NY NZ] [--pixels SIDE] [--rate R] [--rounds N] [--threads T]
//   [--bspline]
// Without --raw, on a procedural volume of 256^3 voxels. Medians of the rounds, in milliseconds and
// nanoseconds a pixel of the picture, and as multiples of setting as much memory; of one thread the
// processor's time, which other work on the machine disturbs least.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/defaults.h"
#include "engine/render/frame_scratch.h"
#include "engine/render/renderer.h"
#include "engine/render/warp.h"
#include "tests/support/volumes.h"

namespace fovea {
namespace {

struct Options {
  std::string raw;
  Int3 dims{256, 256, 256};
  int pixels = 1024;
  double rate = 40;
  int rounds = 15;
  int threads = 1;
  render::Basis basis = render::Basis::kBilinear;
};

Grid LoadRaw(const Options& options) {
  std::ifstream file(options.raw, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  Grid grid(Box3::OfSize(options.dims));
  if (bytes.size() != grid.values.size()) {
    std::fprintf(stderr, "picture_bench: %s has %zu bytes, %zu were expected\n",
                 options.raw.c_str(), bytes.size(), grid.values.size());
    std::exit(2);
  }
  std::transform(bytes.begin(), bytes.end(), grid.values.begin(),
                 [](char c) { return static_cast<float>(static_cast<unsigned char>(c)); });
  return grid;
}

/// Steps take turns, so that what else the machine does falls on all of them.
class Timings {
 public:
  explicit Timings(int threads) : threads_(threads) {}
  void Time(const std::string& name, const std::function<void()>& step) {
    const Stopwatch watch;
    const std::clock_t before = std::clock();
    step();
    const double cpu_ms = 1e3 * static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC;
    Of(name).push_back(threads_ == 1 ? cpu_ms : watch.ElapsedMs());
  }
  void Print(double pixels) {
    const double memset_ms = Median(Of("memset"));
    std::printf("%-22s %9s %9s %9s\n", "step", "ms", "ns/pixel", "memsets");
    for (auto& [name, times] : steps_) {
      const double ms = Median(times);
      std::printf("%-22s %9.3f %9.2f %9.2f\n", name.c_str(), ms, 1e6 * ms / pixels, ms / memset_ms);
    }
  }

 private:
  std::vector<double>& Of(const std::string& name) {
    for (auto& [known, times] : steps_) {
      if (known == name) {
        return times;
      }
    }
    return steps_.emplace_back(name, std::vector<double>()).second;
  }
  static double Median(std::vector<double> times) {
    std::sort(times.begin(), times.end());
    return times[times.size() / 2];
  }
  int threads_;
  std::vector<std::pair<std::string, std::vector<double>>> steps_;
};

void Run(const Options& options) {
  const Grid voxels = options.raw.empty() ? testing::MakeWavyGrid(options.dims) : LoadRaw(options);
  BrickGrid bricks(options.dims, 16, 1, 0.0F);
  bricks.CopyIn(voxels.box, voxels.values);
  const FieldStats stats = ComputeStats(bricks);
  const CoefficientSet set = testing::MakeCoefficients(voxels);
  MemorySource source(set);
  const Vec3 fovea = render::DefaultFovea(source, stats).value();
  const SuperVoxels volume =
      Reconstruct(source, RetainedSet::Make(set.hierarchy, {fovea, options.rate}).value(), 0)
          .value();
  render::RenderSettings settings;
  settings.view = {0, 60, {}, {}};  // 30 degrees off z
  settings.transfer = render::DefaultTransferFunction({&stats, 1}, set.hierarchy);
  settings.width_px = settings.height_px = options.pixels;
  settings.threads = options.threads;

  render::FrameScratch scratch;
  render::Image image;
  std::vector<render::FrameLevel> levels;
  std::vector<uint8_t> bytes;
  Timings timings(options.threads);
  for (int round = 0; round <= options.rounds; ++round) {
    Timings untimed(options.threads);  // the first round brings memory in
    Timings& t = round == 0 ? untimed : timings;
    (void)RenderFoveated(volume, Matrix4{}, settings, &scratch, &image).ok();
    const render::FoveatedFrame& frame = scratch.frame;
    std::vector<render::Layer> layers = scratch.trace.layers;
    const size_t size = image.rgba.size() * sizeof(float);
    t.Time("memset", [&] { std::memset(image.rgba.data(), round, size); });
    t.Time("combine",
           [&] { render::Combine(true, options.threads, &layers, &scratch.combine, &levels); });
    t.Time("smooth",
           [&] { Smooth(frame.levels, options.basis, options.threads, &scratch.expand.levels); });
    t.Time("warp", [&] {
      WarpSmooth(scratch.expand.levels, frame.sheet, frame.warp, options.threads, &image);
    });
    t.Time("smooth and warp", [&] {
      Expand(frame, options.pixels, options.pixels, settings.smoothing, options.basis,
             options.threads, &scratch.expand, &image);
    });
    t.Time("sRGB bytes", [&] { bytes = ToSrgb8(image, {}); });
    t.Time("warp, unsmoothed", [&] {
      Expand(frame, options.pixels, options.pixels, render::Smoothing::kNone, options.basis,
             options.threads, &scratch.expand, &image);
    });
  }
  size_t frame_pixels = 0;
  for (const render::FrameLevel& level : levels) {
    frame_pixels += level.values.size();
  }
  std::printf("rate %g, picture %d x %d, pyramid of %zu pixels in %zu levels\n", options.rate,
              options.pixels, options.pixels, frame_pixels, levels.size());
  timings.Print(static_cast<double>(image.rgba.size()) / 4);
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  fovea::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string flag = argv[i];
    const auto number = [&](int at) { return at < argc ? std::atof(argv[at]) : 0; };
    const auto whole = [&](int at) { return static_cast<int64_t>(number(at)); };
    if (flag == "--raw" && i + 4 < argc) {
      options.raw = argv[i + 1];
      options.dims = {whole(i + 2), whole(i + 3), whole(i + 4)};
      i += 4;
    } else if (flag == "--bspline") {
      options.basis = fovea::render::Basis::kBspline;
    } else if (flag == "--pixels") {
      options.pixels = static_cast<int>(whole(++i));
    } else if (flag == "--rate") {
      options.rate = number(++i);
    } else if (flag == "--rounds") {
      options.rounds = static_cast<int>(whole(++i));
    } else if (flag == "--threads") {
      options.threads = static_cast<int>(whole(++i));
    } else {
      std::fprintf(stderr, "picture_bench: unknown or incomplete flag '%s'\n", argv[i]);
      return 2;
    }
  }
  if (options.rounds < 1 || options.pixels < 1 ||
      options.pixels > fovea::render::kMaxPicturePixels || options.dims.x < 1 ||
      options.dims.y < 1 || options.dims.z < 1 || options.rate < 1) {
    std::fprintf(stderr, "picture_bench: sizes, rate and rounds must be at least 1\n");
    return 2;
  }
  fovea::Run(options);
  return 0;
}
