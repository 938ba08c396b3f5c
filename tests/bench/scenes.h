#ifndef TESTS_BENCH_SCENES_H_
#define TESTS_BENCH_SCENES_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "engine/fovea/coefficient_source.h"
#include "engine/render/renderer.h"
#include "engine/volume/coefficient_set.h"
#include "engine/volume/grid.h"

/// The named volumes and transfer functions that benchmarks compare on. Numbers mean the same from
/// one year to the next as long as these do not change.
namespace fovea::bench {

/// 8-bit voxels, x fastest, and the same as floats: peers take bytes, the engine takes floats.
struct Volume {
  std::string name;
  Int3 dims;
  Vec3 fovea;  // something worth looking at, in voxels
  std::vector<uint8_t> bytes;
  Grid voxels;
};

/// `name`: brain, bonsai or colin27 (the files below $FOVEA_TEST_DATA), any of them with 512 behind
/// it (enlarged trilinearly so that the longest axis has 512 voxels), procedural256 or
/// procedural512. INVALID_ARGUMENT lists the names; NOT_FOUND names the missing file.
[[nodiscard]] StatusOr<Volume> LoadVolume(const std::string& name);

/// 8-bit voxels of a file without header; the fovea in the middle. INVALID_ARGUMENT if its size is
/// not dims.Product().
[[nodiscard]] StatusOr<Volume> LoadRaw(const std::string& path, const Int3& dims);

/// Of values 0 to 255. `opaque`: surfaces; otherwise rays see through most of the object.
[[nodiscard]] render::TransferFunction TransferFor(std::string_view volume, bool opaque);

/// The Haar coefficients of a volume.
[[nodiscard]] StatusOr<CoefficientSet> Transform(const Volume& volume);

/// From above (looking down z), `degrees` off it in the x-z plane; one voxel a pixel, as wide and
/// high as the longest axis. Plain loops run along rows in memory.
[[nodiscard]] render::RenderSettings SettingsFor(const Int3& dims, double degrees,
                                                 const render::TransferFunction& transfer,
                                                 int threads);

/// The middle one; 0 of none.
[[nodiscard]] double Median(std::vector<double> values);

/// Peak signal to noise of two pictures' colours over black, in dB (peak 1).
[[nodiscard]] double Psnr(const render::Image& a, const render::Image& b);

/// Binary PPM, sRGB over black.
[[nodiscard]] Status WritePpm(const render::Image& image, const std::string& path);

}  // namespace fovea::bench

#endif  // TESTS_BENCH_SCENES_H_
