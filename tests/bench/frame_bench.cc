// Milliseconds of a frame, thick rays against plain loops over every voxel, in one run:
//   frame_bench [--raw FILE NX NY NZ] [--size N] [--rounds R] [--threads T]
// Without --raw, on a procedural volume of N^3 voxels (default 256). The two renderers take turns;
// the medians of the rounds are printed, and the ratio of the medians.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/defaults.h"
#include "engine/render/renderer.h"
#include "tests/support/volumes.h"

namespace fovea {
namespace {

struct Options {
  std::string raw;
  Int3 dims{256, 256, 256};
  int rounds = 7;
  int threads = 1;
};

Grid LoadRaw(const Options& options) {
  std::ifstream file(options.raw, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  Grid grid(Box3::OfSize(options.dims));
  if (bytes.size() != grid.values.size()) {
    std::fprintf(stderr, "frame_bench: %s has %zu bytes, %zu were expected\n", options.raw.c_str(),
                 bytes.size(), grid.values.size());
    std::exit(2);
  }
  std::transform(bytes.begin(), bytes.end(), grid.values.begin(),
                 [](char c) { return static_cast<float>(static_cast<unsigned char>(c)); });
  return grid;
}

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

void Run(const Options& options) {
  const Grid voxels = options.raw.empty() ? testing::MakeWavyGrid(options.dims) : LoadRaw(options);
  BrickGrid bricks(options.dims, 16, 1, 0.0F);
  bricks.CopyIn(voxels.box, voxels.values);
  const FieldStats stats = ComputeStats(bricks);
  const CoefficientSet set = testing::MakeCoefficients(voxels);
  MemorySource source(set);
  render::RenderSettings settings;
  settings.view = {0, 60, {}, {}};  // 30 degrees off z: the plain loops run along rows in memory
  settings.transfer = render::DefaultTransferFunction({&stats, 1}, set.hierarchy);
  settings.width_px = settings.height_px = static_cast<int>(options.dims.Max());
  settings.threads = options.threads;
  const Vec3 fovea = render::DefaultFovea(source, stats).value();
  std::printf("%-6s %10s %12s %9s %9s %9s %9s %12s %7s\n", "rate", "m", "samples", "rebuild",
              "rays", "smooth", "total", "plain loops", "ratio");
  for (const double rate : {25.0, 40.0, 100.0}) {
    const RetainedSet retained = RetainedSet::Make(set.hierarchy, {fovea, rate}).value();
    std::vector<double> rebuild, rays, smooth, total, plain;
    render::RenderStats counted;
    for (int round = 0; round < options.rounds; ++round) {
      Stopwatch watch;
      const SuperVoxels volume = Reconstruct(source, retained, options.threads).value();
      rebuild.push_back(watch.ElapsedMs());
      watch.RestartMs();
      (void)render::RenderFoveated(volume, Matrix4{}, settings, &counted).value();
      total.push_back(watch.ElapsedMs());
      rays.push_back(counted.render_ms);
      smooth.push_back(counted.smooth_warp_ms);
      watch.RestartMs();
      (void)render::RenderPlainLoops(voxels, Matrix4{}, settings).value();
      plain.push_back(watch.ElapsedMs());
    }
    std::printf("%-6g %10lld %12llu %9.2f %9.2f %9.2f %9.2f %12.1f %7.1f\n", rate,
                static_cast<long long>(retained.CoefficientCount()),
                static_cast<unsigned long long>(counted.samples), Median(rebuild), Median(rays),
                Median(smooth), Median(total), Median(plain), Median(plain) / Median(total));
  }
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  fovea::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string flag = argv[i];
    const auto number = [&](int at) { return at < argc ? std::atoll(argv[at]) : 0; };
    if (flag == "--raw" && i + 4 < argc) {
      options.raw = argv[i + 1];
      options.dims = {number(i + 2), number(i + 3), number(i + 4)};
      i += 4;
    } else if (flag == "--size") {
      options.dims = {number(i + 1), number(i + 1), number(i + 1)};
      ++i;
    } else if (flag == "--rounds") {
      options.rounds = static_cast<int>(number(++i));
    } else if (flag == "--threads") {
      options.threads = static_cast<int>(number(++i));
    } else {
      std::fprintf(stderr, "frame_bench: unknown or incomplete flag '%s'\n", argv[i]);
      return 2;
    }
  }
  if (options.rounds < 1 || options.dims.x < 1 || options.dims.y < 1 || options.dims.z < 1) {
    std::fprintf(stderr, "frame_bench: sizes and rounds must be at least 1\n");
    return 2;
  }
  fovea::Run(options);
  return 0;
}
