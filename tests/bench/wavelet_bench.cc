// The wavelet transforms against memcpy, one thread unless --threads says otherwise.
//   wavelet_bench [--size N] [--raw FILE] [--rate R] [--rounds N] [--threads N]
//                 [--wavelet haar|cdf53|cdf97] [--inverse 0]: one wavelet; forward only
// Voxels: N^3, procedural, or of a file of N^3 uint8.
// forward: ForwardStream, the whole dense volume of one array pushed at once (float; uint8 for
// the integer bases), all levels, every brick of detail copied to its place in an array as large
// as the coefficients (float; int16). streamed: the same, bricks dropped by the sink. memcpy of the
// bytes of the coefficients, all buffers touched before and larger than the caches, in the same
// round. Processor time with one thread, else by the clock.
// inverse: one level, N/2 to N, everything kept. rebuild: ReconstructInto at the rate, the fovea in
// the middle, coefficients in memory, reading not counted, bounds of blocks counted; `fast` where
// that differs; against memcpy of the kept super-voxels.
// Medians of rounds, and of forward the least.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <string>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/wavelet/forward_stream.h"
#include "engine/wavelet/transform.h"

namespace fovea {
namespace {

struct Options {
  int64_t size = 256;
  double rate = 40;
  int rounds = 7;
  int threads = 1;
  std::string raw, wavelet;
  bool inverse = true;
};

double Median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ssize(values) / 2, values.end());
  return values[values.size() / 2];
}

/// A smooth volume of whole numbers, or the bytes of a file; empty if that cannot be read.
std::vector<uint8_t> MakeVoxels(const Options& options) {
  const int64_t n = options.size;
  std::vector<uint8_t> voxels(static_cast<size_t>(n * n * n));
  if (!options.raw.empty()) {
    std::ifstream file(options.raw, std::ios::binary);
    file.read(reinterpret_cast<char*>(voxels.data()), std::ssize(voxels));
    return file ? voxels : std::vector<uint8_t>();
  }
  size_t i = 0;
  for (int64_t z = 0; z < n; ++z) {
    for (int64_t y = 0; y < n; ++y) {
      for (int64_t x = 0; x < n; ++x, ++i) {
        voxels[i] = static_cast<uint8_t>((x * x + 3 * y * z + 5 * x * y) / 64 % 256);
      }
    }
  }
  return voxels;
}

/// Processor time of one thread, or the clock.
class Timer {
 public:
  explicit Timer(int threads) : one_thread_(threads == 1), start_(Now()) {}
  [[nodiscard]] double Ms() const { return Now() - start_; }

 private:
  [[nodiscard]] double Now() const {
    timespec now{};
    clock_gettime(one_thread_ ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &now);
    return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
  }
  bool one_thread_;
  double start_;
};

/// Copies bricks, level by level, each to a place of its own; or drops them.
class CopySink : public wavelet::DetailSink {
 public:
  CopySink(const Hierarchy& hierarchy, size_t value_bytes, std::vector<std::byte>* to)
      : hierarchy_(hierarchy), brick_bytes_(7 * 4096 * value_bytes), to_(to) {
    size_t at = 0;
    for (int level = hierarchy.finest() - 1; level >= 0; --level) {
      first_.insert(first_.begin(), at);
      const Int3 bricks = Bricks(level);
      at += static_cast<size_t>(bricks.Product()) * brick_bytes_;
    }
    if (to != nullptr) {
      to->resize(at, std::byte{1});
    }
  }
  Status Take(const wavelet::DetailBrick& brick) override {
    if (to_ != nullptr) {
      const Int3 bricks = Bricks(brick.level);
      const auto index = (brick.at.z * bricks.y + brick.at.y) * bricks.x + brick.at.x;
      std::memcpy(to_->data() + first_[static_cast<size_t>(brick.level)] +
                      static_cast<size_t>(index) * brick_bytes_,
                  brick.values.data(), brick.values.size());
    }
    return absl::OkStatus();
  }
  Status EndLayer(int /*level*/, int64_t /*z*/) override { return absl::OkStatus(); }

 private:
  [[nodiscard]] Int3 Bricks(int level) const {
    const Int3 dims = hierarchy_.DimsAt(level);
    return {(dims.x + 15) / 16, (dims.y + 15) / 16, (dims.z + 15) / 16};
  }
  const Hierarchy hierarchy_;
  const size_t brick_bytes_;
  std::vector<size_t> first_;
  std::vector<std::byte>* to_;
};

/// Milliseconds of the whole transform.
template <typename T>
double TimeForward(const Basis& basis, const Hierarchy& hierarchy, const std::vector<T>& voxels,
                   int threads, std::vector<std::byte>* to) {
  CopySink sink(hierarchy, basis.integer ? 2 : 4, to);
  const Timer timer(threads);
  const auto type =
      basis.integer ? wavelet::CoefficientType::kInt16 : wavelet::CoefficientType::kFloat32;
  const auto stream = wavelet::ForwardStream::Make(
      {.hierarchy = hierarchy, .basis = basis, .type = type, .threads = threads}, &sink);
  (void)(*stream)->Push(std::span<const T>(voxels)).ok();
  (void)(*stream)->Finish().ok();
  return timer.Ms();
}

double TimeCopy(int64_t bytes, int threads) {
  static std::vector<char> from, to;
  from.resize(std::max(from.size(), static_cast<size_t>(bytes)), 1);
  to.resize(from.size(), 2);
  const Timer timer(threads);
  std::memcpy(to.data(), from.data(), static_cast<size_t>(bytes));
  return timer.Ms();
}

void Print(const Basis& basis, const char* what, int64_t bytes, const std::vector<double>& times,
           const std::vector<double>& copies) {
  const double ms = Median(times);
  const double copy = Median(copies);
  std::printf("%-6s %-8s %-15s %9.3f %8.2f %8.2f %7.1f\n", WaveletName(basis.wavelet).data(),
              basis.integer ? "integer" : "float", what, ms, static_cast<double>(bytes) / ms / 1e6,
              static_cast<double>(bytes) / copy / 1e6, ms / copy);
}

void MeasureForward(const Basis& basis, const std::vector<uint8_t>& bytes, const Options& options) {
  const int64_t n = options.size;
  const Hierarchy hierarchy = Hierarchy::Make({n, n, n}).value();
  const std::vector<float> floats(bytes.begin(), bytes.end());
  const int64_t size = n * n * n * (basis.integer ? 2 : 4);
  std::vector<std::byte> to;
  std::vector<double> kept, streamed, copy;
  for (int round = 0; round < options.rounds; ++round) {
    for (const bool keep : {true, false}) {
      (keep ? kept : streamed)
          .push_back(
              basis.integer
                  ? TimeForward(basis, hierarchy, bytes, options.threads, keep ? &to : nullptr)
                  : TimeForward(basis, hierarchy, floats, options.threads, keep ? &to : nullptr));
    }
    copy.push_back(TimeCopy(size, options.threads));
  }
  Print(basis, "forward", size, kept, copy);
  Print(basis, "streamed", size, streamed, copy);
  const auto least = [](const std::vector<double>& of) {
    return std::vector<double>{*std::min_element(of.begin(), of.end())};
  };
  Print(basis, "forward, least", size, least(kept), least(copy));
  Print(basis, "streamed, least", size, least(streamed), least(copy));
}

void MeasureInverse(const Basis& basis, const std::vector<uint8_t>& voxels,
                    const Options& options) {
  const int64_t n = options.size;
  const Hierarchy hierarchy = Hierarchy::Make({n, n, n}).value();
  const int64_t bytes = n * n * n * int64_t{sizeof(float)};
  std::vector<double> inverse, rebuild, fast, copy, copy_kept;
  BrickGrid bricks({n, n, n}, 16, 1, 0);
  bricks.CopyIn(Box3::OfSize({n, n, n}), std::vector<float>(voxels.begin(), voxels.end()));
  const CoefficientSet set = wavelet::Forward(bricks, hierarchy, basis, options.threads);
  const Int3 half = hierarchy.DimsAt(hierarchy.finest() - 1);
  const Grid parent(Box3::OfSize(half), 7);
  const std::vector<float> detail(static_cast<size_t>(7 * half.Product()), 1);
  Grid child(Box3::OfSize({n, n, n}));
  const double middle = 0.5 * static_cast<double>(n);
  const RetainedSet retained =
      RetainedSet::Make(hierarchy, {{middle, middle, middle}, options.rate}).value();
  const int64_t kept = retained.SuperVoxelCount() * int64_t{sizeof(float)};
  SuperVoxels volume;
  MemorySource source(set);
  for (int round = 0; round < options.rounds; ++round) {
    const Timer timer(options.threads);
    wavelet::InverseLevel(basis, 0, parent, parent.box, detail, child.box.hi, options.threads,
                          &child);
    inverse.push_back(timer.Ms());
    for (const Reconstruction how : {Reconstruction::kExact, Reconstruction::kFast}) {
      ReconstructStats stats;
      (void)ReconstructInto(source, retained, options.threads, how, &volume, &stats).ok();
      (how == Reconstruction::kExact ? rebuild : fast).push_back(stats.reconstruct_ms);
    }
    copy.push_back(TimeCopy(bytes, options.threads));
    copy_kept.push_back(TimeCopy(kept, options.threads));
  }
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
    } else if (flag == "--raw") {
      options.raw = argv[i + 1];
    } else if (flag == "--wavelet") {
      options.wavelet = argv[i + 1];
    } else if (flag == "--inverse") {
      options.inverse = value != 0;
    } else {
      std::fprintf(stderr, "wavelet_bench: unknown or impossible flag '%s %s'\n", argv[i],
                   argv[i + 1]);
      return 2;
    }
  }
  std::printf("%-6s %-8s %-15s %9s %8s %8s %7s\n", "basis", "", "what", "ms", "GB/s", "memcpy",
              "ratio");
  const std::vector<uint8_t> voxels = fovea::MakeVoxels(options);
  if (voxels.empty()) {
    std::fprintf(stderr, "wavelet_bench: '%s' does not hold %ld^3 bytes\n", options.raw.c_str(),
                 static_cast<long>(options.size));
    return 2;
  }
  for (const fovea::Basis basis :
       {fovea::Basis{fovea::Wavelet::kHaar, false}, fovea::Basis{fovea::Wavelet::kCdf53, false},
        fovea::Basis{fovea::Wavelet::kCdf97, false}, fovea::Basis{fovea::Wavelet::kHaar, true},
        fovea::Basis{fovea::Wavelet::kCdf53, true}}) {
    if (!options.wavelet.empty() && options.wavelet != fovea::WaveletName(basis.wavelet)) {
      continue;
    }
    fovea::MeasureForward(basis, voxels, options);
    if (options.inverse) {
      fovea::MeasureInverse(basis, voxels, options);
    }
  }
  return 0;
}
