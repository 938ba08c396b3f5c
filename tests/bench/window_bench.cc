// How close the shapes of the retained set come to the original at the same m:
//   window_bench --raw FILE NX NY NZ [--big-endian-16] [--rates 25,40]
// For each rate R: the cube of rate R; a ball, and cubes whose sides are as the volume's, whose m
// is within 1 % of the cube's; the smooth window of rate R, whose m is the cube's. PSNR of the
// foveated volume against the original, peak = the value range: over all voxels, and with each
// voxel weighted by (1 + 2 d / R)^-3, d its distance from the fovea: the density of a foveated
// sampling. PSNR of the pictures (default transfer function, azimuth 0 and 30) against full
// resolution.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/defaults.h"
#include "engine/render/renderer.h"
#include "tests/support/volumes.h"

namespace fovea {
namespace {

struct Options {
  std::string raw;
  Int3 dims;
  bool big_endian_16 = false;
  std::vector<double> rates{25, 40};
};

Grid LoadRaw(const Options& options) {
  std::ifstream file(options.raw, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  Grid grid(Box3::OfSize(options.dims));
  const size_t each = options.big_endian_16 ? 2 : 1;
  if (bytes.size() != each * grid.values.size()) {
    std::fprintf(stderr, "window_bench: %s has %zu bytes, %zu were expected\n", options.raw.c_str(),
                 bytes.size(), each * grid.values.size());
    std::exit(2);
  }
  const auto byte = [&](size_t at) { return static_cast<unsigned char>(bytes[at]); };
  for (size_t i = 0; i < grid.values.size(); ++i) {
    grid.values[i] = static_cast<float>(each == 1 ? byte(i) : 256 * byte(2 * i) + byte(2 * i + 1));
  }
  return grid;
}

double Decibels(double squares, double count, double peak) {
  return 10 * std::log10(peak * peak * count / (squares + 1e-20));
}

class Comparison {
 public:
  explicit Comparison(Grid voxels)
      : voxels_(std::move(voxels)),
        set_(testing::MakeCoefficients(voxels_)),
        source_(set_),
        dims_(voxels_.box.Size()) {
    BrickGrid bricks(dims_, 16, 1, 0.0F);
    bricks.CopyIn(voxels_.box, voxels_.values);
    const FieldStats stats = ComputeStats(bricks);
    range_ = stats.maximum - stats.minimum;
    fovea_ = render::DefaultFovea(source_, stats).value();
    settings_.transfer = render::DefaultTransferFunction({&stats, 1}, set_.hierarchy);
    settings_.view.span_voxels = 1.2 * static_cast<double>(dims_.Max());
    settings_.width_px = settings_.height_px = static_cast<int>(*settings_.view.span_voxels);
    for (const double azimuth : {0.0, 30.0}) {
      LookFrom(azimuth);
      full_.push_back(render::RenderReference(voxels_, Matrix4{}, fovea_, settings_).value());
    }
  }

  void Run(double rate) {
    const RetainedSet cube = Make(rate, WindowShape::kCube);
    Print("cube", cube, rate);
    Print("sphere", SameM(cube, WindowShape::kSphere, {1, 1, 1}, rate), rate);
    Print("smooth", Make(rate, WindowShape::kSmooth), rate);
    const double mean = std::cbrt(static_cast<double>(dims_.Product()));
    const Vec3 sides{static_cast<double>(dims_.x) / mean, static_cast<double>(dims_.y) / mean,
                     static_cast<double>(dims_.z) / mean};
    Print("as the volume", SameM(cube, WindowShape::kCube, sides, rate), rate);
  }

 private:
  [[nodiscard]] RetainedSet Make(const Rate& rate, WindowShape shape) const {
    return RetainedSet::Make(set_.hierarchy, {fovea_, rate, shape}).value();
  }

  /// The set of this shape and about these sides whose m is closest to the cube's: by bisection,
  /// then among rates around the one found, since m jumps where many coefficients come in at once.
  [[nodiscard]] RetainedSet SameM(const RetainedSet& cube, WindowShape shape, const Vec3& sides,
                                  double rate) const {
    const auto wanted = static_cast<double>(cube.CoefficientCount());
    const auto at = [&](double r, const Vec3& more) {
      const auto along = [&](int axis) { return std::max(1.0, r * sides[axis] + more[axis]); };
      return Make({along(0), along(1), along(2)}, shape);
    };
    const auto off = [&](const RetainedSet& set) {
      return std::abs(static_cast<double>(set.CoefficientCount()) - wanted);
    };
    double low = rate / 2;
    double high = 2 * rate;
    for (int i = 0; i < 40; ++i) {
      const double middle = (low + high) / 2;
      (static_cast<double>(at(middle, {}).CoefficientCount()) < wanted ? low : high) = middle;
    }
    const double step = shape == WindowShape::kSphere ? 0.2 : 1;
    RetainedSet best = at(high, {});
    for (int i = 0; i < 27; ++i) {
      const RetainedSet near =
          at(high, step * Vec3{static_cast<double>(i % 3 - 1), static_cast<double>(i / 3 % 3 - 1),
                               static_cast<double>(i / 9 - 1)});
      best = off(near) < off(best) ? near : best;
    }
    return best;
  }

  void LookFrom(double azimuth) {
    settings_.view.azimuth_deg = azimuth;
    settings_.view.elevation_deg = azimuth / 2;
  }

  void Print(const char* name, const RetainedSet& retained, double rate) {
    const Grid foveated = ExtractVoxels(source_, voxels_.box, &retained).value();
    double squares = 0;
    double weighted = 0;
    double weights = 0;
    size_t i = 0;
    for (int64_t z = 0; z < dims_.z; ++z) {
      for (int64_t y = 0; y < dims_.y; ++y) {
        for (int64_t x = 0; x < dims_.x; ++x, ++i) {
          const Vec3 centre{static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5,
                            static_cast<double>(z) + 0.5};
          const double error = foveated.values[i] - voxels_.values[i];
          const double weight = std::pow(1 + 2 * Length(centre - fovea_) / rate, -3);
          squares += error * error;
          weighted += weight * error * error;
          weights += weight;
        }
      }
    }
    const SuperVoxels volume = Reconstruct(source_, retained, 0).value();
    double pictures[2] = {};
    for (const int oblique : {0, 1}) {
      LookFrom(30.0 * oblique);
      const render::Image image = render::RenderFoveated(volume, Matrix4{}, settings_).value();
      const render::Image& full = full_[static_cast<size_t>(oblique)];
      double sum = 0;
      for (size_t p = 0; p < image.rgba.size(); ++p) {
        const double error = image.rgba[p] - full.rgba[p];
        sum += error * error;
      }
      pictures[oblique] = Decibels(sum, static_cast<double>(image.rgba.size()), 1);
    }
    const Rate& along = retained.fovea().rate;
    const std::string rates = along.IsIsotropic()
                                  ? fmt::format("{:.4g}", along.x)
                                  : fmt::format("{:.3g},{:.3g},{:.3g}", along.x, along.y, along.z);
    std::printf("%-14s %-18s %10lld %8.2f %8.2f %8.2f %8.2f\n", name, rates.c_str(),
                static_cast<long long>(retained.CoefficientCount()),
                Decibels(squares, static_cast<double>(foveated.values.size()), range_),
                Decibels(weighted, weights, range_), pictures[0], pictures[1]);
  }

  Grid voxels_;
  CoefficientSet set_;
  MemorySource source_;
  Int3 dims_;
  double range_ = 0;
  Vec3 fovea_;
  render::RenderSettings settings_;
  std::vector<render::Image> full_;
};

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  fovea::Options options;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--raw") == 0 && i + 4 < argc) {
      options.raw = argv[i + 1];
      options.dims = {std::atoll(argv[i + 2]), std::atoll(argv[i + 3]), std::atoll(argv[i + 4])};
      i += 4;
    } else if (std::strcmp(argv[i], "--big-endian-16") == 0) {
      options.big_endian_16 = true;
    } else if (std::strcmp(argv[i], "--rates") == 0 && i + 1 < argc) {
      options.rates.clear();
      std::istringstream list(argv[++i]);
      for (double rate = 0; list >> rate; list.ignore(1)) {
        options.rates.push_back(rate);
      }
    } else {
      std::fprintf(stderr, "window_bench: unknown or incomplete flag '%s'\n", argv[i]);
      return 2;
    }
  }
  if (options.raw.empty() || options.dims.Product() < 1) {
    std::fprintf(stderr, "window_bench: name a volume with --raw FILE NX NY NZ\n");
    return 2;
  }
  fovea::Comparison comparison(fovea::LoadRaw(options));
  std::printf("%-14s %-18s %10s %8s %8s %8s %8s\n", "window", "rate", "m", "V_f", "weighted",
              "view 0", "view 30");
  for (const double rate : options.rates) {
    comparison.Run(rate);
  }
  return 0;
}
