// What each wavelet makes of a picture: PSNR against full resolution at the same fovea and rate,
// and what the `fast` inverse loses.
//   basis_bench [volume ...]     (scenes.h names them; default brain bonsai colin27)
// Views 0 and 30 degrees off z, both transfer functions, rates 25 and 40; decibels of the mean
// squared error over the four pictures of a volume and rate. `none`, `full`: smoothing. `fast`:
// with smoothing full. Loss: fast less exact over the super-voxels of all boxes, as a share of the
// value range: root mean square, and largest.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/wavelet/transform.h"
#include "tests/bench/scenes.h"

namespace fovea::bench {
namespace {

constexpr Basis kBases[] = {{Wavelet::kHaar, false},
                            {Wavelet::kCdf53, false},
                            {Wavelet::kCdf97, false},
                            {Wavelet::kHaar, true},
                            {Wavelet::kCdf53, true}};

struct View {
  render::RenderSettings settings;
  render::Image full;
};

StatusOr<std::vector<View>> MakeViews(const Volume& volume) {
  std::vector<View> views;
  for (const double degrees : {0.0, 30.0}) {
    for (const bool opaque : {false, true}) {
      View view;
      view.settings =
          SettingsFor(volume.dims, degrees, TransferFor(volume.name, opaque), /*threads=*/0);
      FOVEA_ASSIGN_OR_RETURN(view.full, render::RenderReference(volume.voxels, Matrix4{},
                                                                volume.fovea, view.settings));
      views.push_back(std::move(view));
    }
  }
  return views;
}

/// Over all views.
StatusOr<double> MeanPsnr(const std::vector<View>& views, const SuperVoxels& super_voxels,
                          render::Smoothing smoothing) {
  double error = 0;
  for (const View& view : views) {
    render::RenderSettings settings = view.settings;
    settings.smoothing = smoothing;
    FOVEA_ASSIGN_OR_RETURN(const render::Image image,
                           render::RenderFoveated(super_voxels, Matrix4{}, settings));
    error += std::pow(10, -Psnr(image, view.full) / 10) / static_cast<double>(views.size());
  }
  return -10 * std::log10(error);
}

struct Loss {
  double rms = 0, most = 0;
};

Loss LossOf(const SuperVoxels& exact, const SuperVoxels& fast, double range) {
  Loss loss;
  double sum = 0;
  int64_t count = 0;
  for (size_t level = 0; level < exact.levels.size(); ++level) {
    const Box3& box = exact.retained.box(static_cast<int>(level));
    for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
      for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
        for (int64_t x = box.lo.x; x < box.hi.x; ++x, ++count) {
          const double far =
              std::abs(exact.levels[level].At(x, y, z) - fast.levels[level].At(x, y, z)) / range;
          sum += far * far;
          loss.most = std::max(loss.most, far);
        }
      }
    }
  }
  loss.rms = std::sqrt(sum / static_cast<double>(count));
  return loss;
}

Status Compare(const Volume& volume) {
  FOVEA_ASSIGN_OR_RETURN(const Hierarchy hierarchy, Hierarchy::Make(volume.dims));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<View> views, MakeViews(volume));
  BrickGrid bricks(volume.dims, 16, 1, 0);
  bricks.CopyIn(volume.voxels.box, volume.voxels.values);
  for (const Basis& basis : kBases) {
    const CoefficientSet set = wavelet::Forward(bricks, hierarchy, basis, 0);
    MemorySource source(set);
    for (const double rate : {25.0, 40.0}) {
      FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                             RetainedSet::Make(hierarchy, {volume.fovea, rate}));
      FOVEA_ASSIGN_OR_RETURN(const SuperVoxels exact, Reconstruct(source, retained, 0));
      FOVEA_ASSIGN_OR_RETURN(const SuperVoxels fast,
                             Reconstruct(source, retained, 0, nullptr, Reconstruction::kFast));
      FOVEA_ASSIGN_OR_RETURN(const double none, MeanPsnr(views, exact, render::Smoothing::kNone));
      FOVEA_ASSIGN_OR_RETURN(const double full, MeanPsnr(views, exact, render::Smoothing::kFull));
      FOVEA_ASSIGN_OR_RETURN(const double quick, MeanPsnr(views, fast, render::Smoothing::kFull));
      const Loss loss = LossOf(exact, fast, 255);
      std::printf("%-10s %-6s %-8s %4g %8.2f %8.2f %8.2f %9.3f %% %6.1f %%\n", volume.name.c_str(),
                  std::string(WaveletName(basis.wavelet)).c_str(),
                  basis.integer ? "integer" : "float", rate, none, full, quick, 100 * loss.rms,
                  100 * loss.most);
    }
  }
  return absl::OkStatus();
}

Status Run(std::vector<std::string> names) {
  if (names.empty()) {
    names = {"brain", "bonsai", "colin27"};
  }
  std::printf("%-10s %-6s %-8s %4s %8s %8s %8s %11s %8s\n", "volume", "basis", "", "rate", "none",
              "full", "fast", "loss rms", "largest");
  for (const std::string& name : names) {
    FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume(name));
    FOVEA_RETURN_IF_ERROR(Compare(volume));
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace fovea::bench

int main(int argc, char** argv) {
  const fovea::Status status = fovea::bench::Run({argv + 1, argv + argc});
  if (!status.ok()) {
    std::fprintf(stderr, "basis_bench: %s\n", std::string(fovea::MessageOf(status)).c_str());
    return 1;
  }
  return 0;
}
