// Nanoseconds a sample of the compositing kernel alone, nothing skipped, by instruction set:
//   slab_bench [--pixels N] [--rounds R]
// Rows of N pixels (default 64, a window's row) of random values through transfer functions of 2 to
// 64 points. The medians of the rounds.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include <hwy/targets.h>

#include "engine/base/stopwatch.h"
#include "engine/render/slab_kernel.h"

namespace fovea::render {
namespace {

TransferFunction RandomFunction(int points) {
  TransferFunction transfer;
  for (int i = 0; i < points; ++i) {
    const float f = static_cast<float>(i) / static_cast<float>(points - 1);
    transfer.points.push_back({f, {f, 1 - f, 0.5F}, 0.001F + 0.02F * f});
  }
  return transfer;
}

struct Planes {
  explicit Planes(size_t n) : red(n), green(n), blue(n), transmittance(n, 1.0F) {}
  std::vector<float> red, green, blue, transmittance;
};

double NanosecondsASample(int64_t pixels, int rounds, int points, bool shaded, bool by_polynomial) {
  constexpr int64_t kRows = 64;
  const int64_t stride = pixels + 8;
  std::vector<float> values(static_cast<size_t>(stride * (kRows + 8)));
  std::mt19937 random(1);
  for (float& value : values) {
    value = std::uniform_real_distribution<float>(0, 1)(random);
  }
  Planes planes(static_cast<size_t>(8 * pixels));
  const KernelFunction function(RandomFunction(points));
  const KernelLight light{
      {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 1}, {0, 0, 1}, 0.3F, 0.6F, 0.3F, 4, 1e-4F};
  Slab slab;
  slab.taps = values.data();
  slab.row_stride = stride;
  slab.slice_stride = stride;
  slab.fu = 0.3F;
  slab.fv = 0.6F;
  slab.length = 2.3F;
  const SlabCover cover(slab.length, 0.021);
  slab.cover = by_polynomial ? &cover : nullptr;
  slab.red = planes.red.data();
  slab.green = planes.green.data();
  slab.blue = planes.blue.data();
  slab.transmittance = planes.transmittance.data();
  std::vector<SlabRun> runs;
  for (int64_t row = 2; row < kRows; ++row) {
    runs.push_back({row * stride + 2, (row % 8) * pixels, pixels});
  }
  std::vector<double> times;
  for (int round = 0; round < rounds; ++round) {
    constexpr int kRepeats = 20;
    Stopwatch watch;
    for (int repeat = 0; repeat < kRepeats; ++repeat) {
      std::fill(planes.transmittance.begin(), planes.transmittance.end(), 1.0F);
      CompositeSlab(function, function, shaded ? &light : nullptr, slab, runs);
    }
    times.push_back(watch.ElapsedMs() * 1e6 / static_cast<double>(kRepeats * (kRows - 2) * pixels));
  }
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

void Run(int64_t pixels, int rounds) {
  std::printf("%lld pixels a row; ns a sample\n%-8s", static_cast<long long>(pixels), "points");
  const std::vector<int> points = {2, 3, 5, 9, 25, 64};
  for (const int n : points) {
    std::printf("%8d", n);
  }
  std::printf("%14s%14s\n", "5, log, exp", "5, shaded");
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    std::printf("%-8s", KernelTarget().c_str());
    for (const int n : points) {
      std::printf("%8.2f", NanosecondsASample(pixels, rounds, n, false, true));
    }
    std::printf("%14.2f", NanosecondsASample(pixels, rounds, 5, false, false));
    std::printf("%14.2f\n", NanosecondsASample(pixels, rounds, 5, true, false));
  }
}

}  // namespace
}  // namespace fovea::render

int main(int argc, char** argv) {
  int pixels = 64;
  int rounds = 15;
  for (int i = 1; i + 1 < argc; i += 2) {
    (std::string(argv[i]) == "--pixels" ? pixels : rounds) = std::atoi(argv[i + 1]);
  }
  fovea::render::Run(pixels, rounds);
}
