// Thick rays against VolPack (Lacroute and Levoy's own shear-warp library), one thread, the same
// volume, transfer function and view, a picture as wide as the volume:
//   volpack_bench [--scenes brain,bonsai,...] [--rounds R] [--degrees D] [--pictures FOLDER]
//   volpack_bench --report table1 [--rounds R]     the columns of Yu et al., Table 1
// Volumes are those of tests/bench/scenes.h; shared ones are read below $FOVEA_TEST_DATA.
//
// VolPack does RGB work: 16 bits a voxel (the least its colour tables take), opacity and colour
// from tables indexed by it, opacities corrected for the angle, early termination at its manual's
// 0.95, voxels at or below half an 8-bit step of opacity left out. "classified" renders its
// run-length encoded volume (its fastest mode); "anew" classifies again through a min-max octree
// first, which is what a new transfer function costs in that mode; "raw" renders from the octree
// without classifying. Thick rays are rendered from reconstructed super-voxels, smoothing (full)
// and warp included, and need nothing more for a new transfer function. The two take turns; medians
// of the rounds.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <volpack.h>

#include "engine/fovea/reconstruct.h"
#include "tests/bench/frame_clock.h"
#include "tests/bench/scenes.h"

namespace fovea::bench {
namespace {

struct Options {
  std::vector<std::string> scenes{"brain", "bonsai", "bonsai512", "colin27512", "procedural512"};
  int rounds = 7;
  double degrees = 30;
  std::string pictures;
  bool table1 = false;
};

/// VolPack's errors are a mistake of this program: say which call, and stop.
void Check(vpContext* context, vpResult result, const char* call) {
  if (result != VP_OK) {
    std::fprintf(stderr, "volpack_bench: %s: %s\n", call, vpGetErrorString(vpGetError(context)));
    std::exit(1);
  }
}
#define FOVEA_VP(call) Check(context_.get(), call, #call)

/// A volume in VolPack: one number a voxel is both what is classified and what is coloured.
class VolPack {
 public:
  VolPack(const Volume& volume, const render::RenderSettings& settings)
      : context_(vpCreateContext(), &vpDestroyContext),
        voxels_(volume.bytes.begin(), volume.bytes.end()),
        width_(settings.width_px),
        height_(settings.height_px),
        pixels_(static_cast<size_t>(3 * width_ * height_)) {
    const auto x = static_cast<int>(volume.dims.x);
    const auto y = static_cast<int>(volume.dims.y);
    const auto z = static_cast<int>(volume.dims.z);
    vpContext* vpc = context_.get();
    FOVEA_VP(vpSetVolumeSize(vpc, x, y, z));
    FOVEA_VP(vpSetVoxelSize(vpc, 2, 1, 1, 1));
    FOVEA_VP(vpSetVoxelField(vpc, 0, 2, 0, 255));
    FOVEA_VP(vpSetRawVoxels(vpc, voxels_.data(), 2 * x * y * z, 2, 2 * x, 2 * x * y));
    FOVEA_VP(vpSetClassifierTable(vpc, 0, 0, opacity_, sizeof(opacity_)));
    FOVEA_VP(vpSetLookupShader(vpc, 3, 1, 0, color_, sizeof(color_), 0, nullptr, 0));
    FOVEA_VP(vpSetd(vpc, VP_MAX_RAY_OPACITY, 0.95));
    FOVEA_VP(vpSetd(vpc, VP_MIN_VOXEL_OPACITY, 0.5 / 255));
    FOVEA_VP(vpSetImage(vpc, pixels_.data(), width_, height_, 3 * width_, VP_RGB));
    SetView(settings, volume.dims);
    SetTransfer(settings.transfer);
  }

  /// What speeds classifying up, and rendering without it.
  void MakeOctree() {
    FOVEA_VP(vpMinMaxOctreeThreshold(context_.get(), 0, 4));
    FOVEA_VP(vpCreateMinMaxOctree(context_.get(), 0, 4));
  }

  /// Opacities and colours of the 256 values; what was classified before is now out of date.
  void SetTransfer(const render::TransferFunction& transfer) {
    for (int value = 0; value < 256; ++value) {
      const render::TransferFunction::Point p = At(transfer, value);
      opacity_[value] = p.opacity;
      color_[3 * value] = 255 * p.color.red;
      color_[3 * value + 1] = 255 * p.color.green;
      color_[3 * value + 2] = 255 * p.color.blue;
    }
  }
  void Classify() { FOVEA_VP(vpClassifyVolume(context_.get())); }
  void RenderClassified() { FOVEA_VP(vpRenderClassifiedVolume(context_.get())); }
  void RenderRaw() { FOVEA_VP(vpRenderRawVolume(context_.get())); }

  /// The picture in our convention.
  [[nodiscard]] render::Image Picture() const {
    render::Image image{width_, height_, {}};
    for (size_t i = 0; i < pixels_.size(); i += 3) {
      for (size_t channel = 0; channel < 3; ++channel) {
        image.rgba.push_back(static_cast<float>(pixels_[i + channel]) / 255);
      }
      image.rgba.push_back(1);
    }
    return image;
  }

 private:
  static render::TransferFunction::Point At(const render::TransferFunction& transfer,
                                            double value) {
    const auto& points = transfer.points;
    if (value <= points.front().value) {
      return points.front();
    }
    for (size_t i = 1; i < points.size(); ++i) {
      if (value <= points[i].value) {
        const auto& [v0, c0, a0] = points[i - 1];
        const auto& [v1, c1, a1] = points[i];
        const auto f = static_cast<float>((value - v0) / (v1 - v0));
        return {value,
                {c0.red + f * (c1.red - c0.red), c0.green + f * (c1.green - c0.green),
                 c0.blue + f * (c1.blue - c0.blue)},
                a0 + f * (a1 - a0)};
      }
    }
    return points.back();
  }

  /// World to eye: x right, y down (row 0 of VolPack's picture has the least y), sight along z. The
  /// volume's longest axis has length 1 around the origin.
  void SetView(const render::RenderSettings& settings, const Int3& dims) {
    vpContext* vpc = context_.get();
    const render::ShearView view =
        render::FactorView(settings.view, dims, Matrix4{}, width_, height_);
    const Vec3 right = Unit(Cross(view.sight, {0, 0, 1}));
    const Vec3 up = Cross(right, view.sight);
    vpMatrix4 eye = {{right.x, right.y, right.z, 0},
                     {-up.x, -up.y, -up.z, 0},
                     {view.sight.x, view.sight.y, view.sight.z, 0},
                     {0, 0, 0, 1}};
    FOVEA_VP(vpCurrentMatrix(vpc, VP_VIEW));
    FOVEA_VP(vpSetMatrix(vpc, eye));
    const double half = 0.5 * *settings.view.span_voxels / static_cast<double>(dims.Max());
    // VolPack's pixels and voxels have their centres at whole numbers, ours at halves.
    const double half_pixel = half / width_;
    FOVEA_VP(vpCurrentMatrix(vpc, VP_PROJECT));
    FOVEA_VP(vpIdentityMatrix(vpc));
    FOVEA_VP(vpWindow(vpc, VP_PARALLEL, half_pixel - half, half_pixel + half, half_pixel - half,
                      half_pixel + half, -2, 2));
    const double half_voxel = 0.5 / static_cast<double>(dims.Max());
    FOVEA_VP(vpCurrentMatrix(vpc, VP_MODEL));
    FOVEA_VP(vpTranslate(vpc, half_voxel, half_voxel, half_voxel));
  }
  static Vec3 Unit(const Vec3& v) { return 1 / Length(v) * v; }

  std::unique_ptr<vpContext, decltype(&vpDestroyContext)> context_;
  std::vector<uint16_t> voxels_;
  int width_, height_;
  std::vector<unsigned char> pixels_;
  float opacity_[256] = {};
  float color_[3 * 256] = {};
};

struct Medians {
  double fovea_ms, classified_ms, anew_ms, raw_ms;
};

/// A frame of ours in buffers that are kept, as a viewer keeps them.
void RenderOrDie(const SuperVoxels& volume, const render::RenderSettings& settings,
                 Buffers* buffers) {
  const Status status = TimeFrame(volume, settings, buffers).status();
  if (!status.ok()) {
    std::fprintf(stderr, "volpack_bench: %s\n", std::string(MessageOf(status)).c_str());
    std::exit(1);
  }
}

Medians Measure(const SuperVoxels& volume, const render::RenderSettings& settings, int rounds,
                VolPack* volpack) {
  std::vector<double> fovea, classified, anew, raw;
  Buffers buffers;
  for (int round = 0; round < rounds; ++round) {
    WorkClock watch(1);
    RenderOrDie(volume, settings, &buffers);
    fovea.push_back(watch.RestartMs());
    volpack->RenderClassified();
    classified.push_back(watch.RestartMs());
  }
  for (int round = 0; round < std::min(rounds, 3); ++round) {
    WorkClock watch(1);
    volpack->SetTransfer(settings.transfer);
    volpack->Classify();
    volpack->RenderClassified();
    anew.push_back(watch.RestartMs());
    volpack->RenderRaw();
    raw.push_back(watch.RestartMs());
    RenderOrDie(volume, settings, &buffers);
    fovea.push_back(watch.RestartMs());
  }
  return {Median(fovea), Median(classified), Median(anew), Median(raw)};
}

Status RunScene(const Options& options, const Volume& volume, const CoefficientSet& coefficients,
                bool opaque) {
  const double rate = volume.dims.Max() > 256 ? 40 : 25;
  const render::RenderSettings settings =
      SettingsFor(volume.dims, options.degrees, TransferFor(volume.name, opaque), 1);
  MemorySource source(coefficients);
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(coefficients.hierarchy, Fovea{volume.fovea, rate}));
  FOVEA_ASSIGN_OR_RETURN(const SuperVoxels foveated, Reconstruct(source, retained, 1));
  VolPack volpack(volume, settings);
  volpack.MakeOctree();
  volpack.Classify();
  const Medians ms = Measure(foveated, settings, options.rounds, &volpack);
  FOVEA_ASSIGN_OR_RETURN(const render::Image reference,
                         render::RenderReference(volume.voxels, Matrix4{}, volume.fovea, settings));
  FOVEA_ASSIGN_OR_RETURN(const render::Image ours,
                         render::RenderFoveated(foveated, Matrix4{}, settings));
  volpack.RenderClassified();
  const render::Image theirs = volpack.Picture();
  std::printf("%-14s %-6s %4g %8.2f %10.2f %9.1f %9.1f %8.1f x %8.1f x %8.1f x %6.1f %6.1f\n",
              volume.name.c_str(), opaque ? "opaque" : "semi", rate, ms.fovea_ms, ms.classified_ms,
              ms.anew_ms, ms.raw_ms, ms.classified_ms / ms.fovea_ms, ms.anew_ms / ms.fovea_ms,
              ms.raw_ms / ms.fovea_ms, Psnr(theirs, reference), Psnr(ours, reference));
  std::fflush(stdout);
  if (!options.pictures.empty()) {
    const std::string stem =
        fmt::format("{}/{}_{}", options.pictures, volume.name, opaque ? "opaque" : "semi");
    FOVEA_RETURN_IF_ERROR(WritePpm(theirs, stem + "_volpack.ppm"));
    FOVEA_RETURN_IF_ERROR(WritePpm(ours, stem + "_fovea.ppm"));
    FOVEA_RETURN_IF_ERROR(WritePpm(reference, stem + "_reference.ppm"));
  }
  return absl::OkStatus();
}

/// The columns of Yu et al., Table 1: frames a second of plain loops along x, of VolPack (with the
/// seconds to make its volume, its octree and its classified volume) and of thick rays at rate 25,
/// reconstruction included, both at 45 degrees. Nothing is shaded, so making VolPack's volume is
/// only copying it.
Status RunTable1(const Options& options, const Volume& volume, const CoefficientSet& coefficients) {
  MemorySource source(coefficients);
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(coefficients.hierarchy, Fovea{volume.fovea, 25}));
  for (const bool opaque : {false, true}) {
    const render::RenderSettings settings =
        SettingsFor(volume.dims, 45, TransferFor(volume.name, opaque), 1);
    render::RenderSettings along_x = settings;
    along_x.view = {0, 0, {}, settings.view.span_voxels};
    std::vector<double> plain, make, octree, classify, frame, fovea;
    Buffers buffers;
    for (int round = 0; round < options.rounds; ++round) {
      WorkClock watch(1);
      (void)render::RenderPlainLoops(volume.voxels, Matrix4{}, along_x).value();
      plain.push_back(watch.RestartMs());
      VolPack volpack(volume, settings);
      make.push_back(watch.RestartMs());
      volpack.MakeOctree();
      octree.push_back(watch.RestartMs());
      volpack.Classify();
      classify.push_back(watch.RestartMs());
      volpack.RenderClassified();  // the first frame also allocates
      watch.RestartMs();
      volpack.RenderClassified();
      frame.push_back(watch.RestartMs());
      const SuperVoxels foveated = Reconstruct(source, retained, 1).value();
      RenderOrDie(foveated, settings, &buffers);
      fovea.push_back(watch.RestartMs());
    }
    std::printf("%-10s %-6s %8.1f %8.1f %8.2f %8.2f %8.2f %8.1f\n", volume.name.c_str(),
                opaque ? "opaque" : "semi", 1e3 / Median(plain), 1e3 / Median(frame),
                Median(make) / 1e3, Median(octree) / 1e3, Median(classify) / 1e3,
                1e3 / Median(fovea));
  }
  return absl::OkStatus();
}

Status Run(const Options& options) {
  if (options.table1) {
    std::printf("%-10s %-6s %8s %8s %8s %8s %8s %8s\n", "volume", "", "direct", "VolPack", "MV s",
                "MO s", "CV s", "ours");
    for (const char* name : {"brain", "bonsai", "colin27"}) {
      FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume(name));
      FOVEA_ASSIGN_OR_RETURN(const CoefficientSet coefficients, Transform(volume));
      FOVEA_RETURN_IF_ERROR(RunTable1(options, volume, coefficients));
    }
    return absl::OkStatus();
  }
  std::printf("%-14s %-6s %4s %8s %10s %9s %9s %10s %10s %10s %6s %6s\n", "volume", "", "rate",
              "fovea ms", "classified", "anew", "raw", "", "anew", "raw", "PSNR", "ours");
  for (const std::string& scene : options.scenes) {
    FOVEA_ASSIGN_OR_RETURN(const Volume volume, LoadVolume(scene));
    FOVEA_ASSIGN_OR_RETURN(const CoefficientSet coefficients, Transform(volume));
    for (const bool opaque : {false, true}) {
      FOVEA_RETURN_IF_ERROR(RunScene(options, volume, coefficients, opaque));
    }
  }
  return absl::OkStatus();
}

int Usage() {
  std::fprintf(stderr,
               "usage: volpack_bench [--scenes A,B,...] [--rounds R] [--degrees D] "
               "[--pictures FOLDER] [--report frames|table1]\n");
  return 2;
}

int Main(const std::vector<std::string>& arguments) {
  Options options;
  for (size_t i = 0; i + 1 < arguments.size(); i += 2) {
    const std::string& flag = arguments[i];
    const std::string& value = arguments[i + 1];
    if (flag == "--scenes") {
      options.scenes.clear();
      std::istringstream list(value);
      for (std::string name; std::getline(list, name, ',');) {
        options.scenes.push_back(name);
      }
    } else if (flag == "--rounds") {
      options.rounds = std::atoi(value.c_str());
    } else if (flag == "--degrees") {
      options.degrees = std::atof(value.c_str());
    } else if (flag == "--report" && (value == "frames" || value == "table1")) {
      options.table1 = value == "table1";
    } else if (flag == "--pictures") {
      options.pictures = value;
    } else {
      return Usage();
    }
  }
  if (arguments.size() % 2 != 0 || options.rounds < 1) {
    return Usage();
  }
  const Status status = Run(options);
  if (!status.ok()) {
    std::fprintf(stderr, "volpack_bench: %s\n", std::string(MessageOf(status)).c_str());
  }
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace fovea::bench

int main(int argc, char** argv) {
  return fovea::bench::Main(std::vector<std::string>(argv + 1, argv + argc));
}
