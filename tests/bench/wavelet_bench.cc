// The wavelet transforms against memcpy, one thread unless --threads says otherwise.
//   wavelet_bench [--size N] [--rate R] [--rounds N] [--threads N]
// forward: voxels in bricks to all coefficients. inverse: one level, N/2 to N, everything kept.
// rebuild: ReconstructInto at the rate, the fovea in the middle, coefficients in memory, reading
// not counted, bounds of blocks counted; `fast` where that differs. GB/s: bytes of voxels (forward,
// inverse) or of kept super-voxels (rebuild) a second; memcpy of the same number of bytes, buffers
// already touched, is in the same round.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/fovea/reconstruct.h"
#include "engine/wavelet/transform.h"

namespace fovea {
namespace {

struct Options {
  int64_t size = 256;
  double rate = 40;
  int rounds = 7;
  int threads = 1;
};

double Median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ssize(values) / 2, values.end());
  return values[values.size() / 2];
}

/// A smooth volume of whole numbers, 0 to 255, in bricks.
BrickGrid MakeVoxels(int64_t n) {
  Grid grid(Box3::OfSize({n, n, n}));
  size_t i = 0;
  for (int64_t z = 0; z < n; ++z) {
    for (int64_t y = 0; y < n; ++y) {
      for (int64_t x = 0; x < n; ++x, ++i) {
        grid.values[i] = static_cast<float>((x * x + 3 * y * z + 5 * x * y) / 64 % 256);
      }
    }
  }
  BrickGrid bricks(grid.box.hi, 16, 1, 0);
  bricks.CopyIn(grid.box, grid.values);
  return bricks;
}

double TimeCopy(int64_t bytes) {
  static std::vector<char> from, to;
  from.resize(static_cast<size_t>(bytes), 1);
  to.resize(static_cast<size_t>(bytes), 2);
  const Stopwatch watch;
  std::memcpy(to.data(), from.data(), static_cast<size_t>(bytes));
  return watch.ElapsedMs();
}

void Print(const Basis& basis, const char* what, int64_t bytes, const std::vector<double>& times,
           const std::vector<double>& copies) {
  const double ms = Median(times);
  const double copy = Median(copies);
  std::printf("%-6s %-8s %-12s %9.3f %8.2f %8.2f %7.1f\n", WaveletName(basis.wavelet).data(),
              basis.integer ? "integer" : "float", what, ms, static_cast<double>(bytes) / ms / 1e6,
              static_cast<double>(bytes) / copy / 1e6, ms / copy);
}

void Measure(const Basis& basis, const BrickGrid& voxels, const Options& options) {
  const Hierarchy hierarchy = Hierarchy::Make(voxels.dims()).value();
  const int64_t n = options.size;
  const int64_t bytes = n * n * n * int64_t{sizeof(float)};
  std::vector<double> forward, inverse, rebuild, fast, copy, copy_kept;
  CoefficientSet set;
  const Int3 half = hierarchy.DimsAt(hierarchy.finest() - 1);
  const Grid parent(Box3::OfSize(half), 7);
  const std::vector<float> detail(static_cast<size_t>(7 * half.Product()), 1);
  Grid child(Box3::OfSize({n, n, n}));
  const Vec3 middle{0.5 * static_cast<double>(n), 0.5 * static_cast<double>(n),
                    0.5 * static_cast<double>(n)};
  const RetainedSet retained = RetainedSet::Make(hierarchy, {middle, options.rate}).value();
  const int64_t kept = retained.SuperVoxelCount() * int64_t{sizeof(float)};
  SuperVoxels volume;
  for (int round = 0; round < options.rounds; ++round) {
    Stopwatch watch;
    set = wavelet::Forward(voxels, hierarchy, basis, options.threads);
    forward.push_back(watch.RestartMs());
    wavelet::InverseLevel(basis, 0, parent, parent.box, detail, child.box.hi, options.threads,
                          &child);
    inverse.push_back(watch.ElapsedMs());
    MemorySource source(set);
    for (const Reconstruction how : {Reconstruction::kExact, Reconstruction::kFast}) {
      ReconstructStats stats;
      (void)ReconstructInto(source, retained, options.threads, how, &volume, &stats).ok();
      (how == Reconstruction::kExact ? rebuild : fast).push_back(stats.reconstruct_ms);
    }
    copy.push_back(TimeCopy(bytes));
    copy_kept.push_back(TimeCopy(kept));
  }
  Print(basis, "forward", bytes, forward, copy);
  Print(basis, "inverse", bytes, inverse, copy);
  Print(basis, "rebuild", kept, rebuild, copy_kept);
  if (basis.wavelet != Wavelet::kHaar) {
    Print(basis, "rebuild fast", kept, fast, copy_kept);
  }
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  fovea::Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string flag = argv[i];
    const double value = std::atof(argv[i + 1]);
    if (flag == "--size" && value >= 1 && value <= 1024) {
      options.size = static_cast<int64_t>(value);
    } else if (flag == "--rate" && value >= 1) {
      options.rate = value;
    } else if (flag == "--rounds" && value >= 1) {
      options.rounds = static_cast<int>(value);
    } else if (flag == "--threads" && value >= 0) {
      options.threads = static_cast<int>(value);
    } else {
      std::fprintf(stderr, "wavelet_bench: unknown or impossible flag '%s %s'\n", argv[i],
                   argv[i + 1]);
      return 2;
    }
  }
  std::printf("%-6s %-8s %-12s %9s %8s %8s %7s\n", "basis", "", "what", "ms", "GB/s", "memcpy",
              "ratio");
  const fovea::BrickGrid voxels = fovea::MakeVoxels(options.size);
  for (const fovea::Basis basis :
       {fovea::Basis{fovea::Wavelet::kHaar, false}, fovea::Basis{fovea::Wavelet::kCdf53, false},
        fovea::Basis{fovea::Wavelet::kCdf97, false}, fovea::Basis{fovea::Wavelet::kHaar, true},
        fovea::Basis{fovea::Wavelet::kCdf53, true}}) {
    fovea::Measure(basis, voxels, options);
  }
  return 0;
}
