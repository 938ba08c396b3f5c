// What smoothing is for, measured on real volumes: a foveated picture that is closer to the
// full-resolution one, and has no blocks in front of the fovea.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/defaults.h"
#include "engine/render/renderer.h"
#include "engine/store/dataset.h"
#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::render {
namespace {

struct RealVolume {
  std::string name;
  std::string file;
  Int3 dims;
  int bytes = 1;               // a voxel; 2: big-endian
  double allowed_loss_db = 0;  // smoothed against unsmoothed
};

/// None where nothing says where they are.
std::vector<RealVolume> RealVolumes() {
  if (std::getenv("FOVEA_TEST_DATA") == nullptr) {
    return {};
  }
  return {{"brain", "volumes/brain_volpack_128x128x84_u8.raw", {128, 128, 84}},
          {"bonsai", "volumes/bonsai_ct_256x256x256_u8.raw", {256, 256, 256}},
          {"tooth", "volumes/tooth_ct_103x94x161_u16be.raw", {103, 94, 161}, 2},
          {"colin27", "volumes/colin27_mri_181x217x181_u8.raw", {181, 217, 181}, 1, 0.1}};
}

Grid Load(const RealVolume& volume) {
  std::ifstream file(std::string(std::getenv("FOVEA_TEST_DATA")) + "/" + volume.file,
                     std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  Grid grid(Box3::OfSize(volume.dims));
  EXPECT_EQ(bytes.size(), grid.values.size() * volume.bytes) << volume.file;
  for (size_t i = 0; i < grid.values.size() && bytes.size() == grid.values.size() * volume.bytes;
       ++i) {
    const auto byte = [&](size_t at) { return static_cast<unsigned char>(bytes[at]); };
    grid.values[i] =
        static_cast<float>(volume.bytes == 1 ? byte(i) : 256 * byte(2 * i) + byte(2 * i + 1));
  }
  return grid;
}

double Psnr(const Image& a, const Image& b) {
  double sum = 0;
  for (size_t i = 0; i < a.rgba.size(); ++i) {
    const double difference = a.rgba[i] - b.rgba[i];
    sum += difference * difference;
  }
  return -10 * std::log10(sum / static_cast<double>(a.rgba.size()) + 1e-20);
}

/// Mean step between neighbouring pixels that straddle a border of `width`-voxel pixels of the
/// sheared image, over the mean step between those that do not; rows and columns near the fovea.
double BorderRatio(const Image& image, const ShearView& shear, int64_t width, const Vec3& fovea,
                   double reach) {
  double sum[2] = {};
  double count[2] = {};
  const auto& m = shear.warp;
  const double fovea_u = fovea[shear.axis_u] - shear.slope_u * fovea[shear.axis_k];
  const double fovea_v = fovea[shear.axis_v] - shear.slope_v * fovea[shear.axis_k];
  const auto cell = [&](double x) { return std::floor(x / static_cast<double>(width)); };
  for (int j = 0; j + 1 < image.height; ++j) {
    for (int i = 0; i + 1 < image.width; ++i) {
      const double u = m[0] * i + m[1] * j + m[2];
      const double v = m[3] * i + m[4] * j + m[5];
      if (std::abs(u - fovea_u) > reach || std::abs(v - fovea_v) > reach) {
        continue;
      }
      for (int direction = 0; direction < 2; ++direction) {
        const bool across =
            cell(u) != cell(u + m[direction]) || cell(v) != cell(v + m[3 + direction]);
        const size_t at = 4 * (static_cast<size_t>(j) * image.width + i);
        const size_t next = at + 4 * (direction == 0 ? 1 : static_cast<size_t>(image.width));
        for (int c = 0; c < 3; ++c) {
          sum[across] += std::abs(image.rgba[next + c] - image.rgba[at + c]);
          count[across] += 1;
        }
      }
    }
  }
  return (sum[1] / count[1]) / (sum[0] / count[0]);
}

/// Renders `voxels` foveated and at full resolution, along an axis and obliquely.
void CheckPictures(const std::string& name, const Grid& voxels, const std::vector<double>& rates,
                   double allowed_loss_db) {
  const Int3 dims = voxels.box.Size();
  const CoefficientSet set = testing::MakeCoefficients(voxels);
  BrickGrid bricks(dims, 16, 1, 0.0F);
  bricks.CopyIn(voxels.box, voxels.values);
  const FieldStats stats = ComputeStats(bricks);
  MemorySource source(set);
  RenderSettings settings;
  settings.transfer = DefaultTransferFunction({&stats, 1}, set.hierarchy);
  settings.view.span_voxels = 1.2 * static_cast<double>(dims.Max());
  settings.width_px = settings.height_px = static_cast<int>(*settings.view.span_voxels);
  ASSERT_OK_AND_ASSIGN(const Vec3 fovea, DefaultFovea(source, stats));
  for (const double azimuth : {0.0, 30.0}) {
    settings.view.azimuth_deg = azimuth;
    settings.view.elevation_deg = azimuth / 2;
    const ShearView shear =
        FactorView(settings.view, dims, Matrix4{}, settings.width_px, settings.height_px);
    ASSERT_OK_AND_ASSIGN(const Image full, RenderReference(voxels, Matrix4{}, fovea, settings));
    for (const double rate : rates) {
      const RetainedSet retained = RetainedSet::Make(set.hierarchy, {fovea, rate}).value();
      const SuperVoxels super_voxels = Reconstruct(source, retained, 0).value();
      settings.smoothing = Smoothing::kNone;
      ASSERT_OK_AND_ASSIGN(const Image blocks, RenderFoveated(super_voxels, Matrix4{}, settings));
      settings.smoothing = Smoothing::kFull;
      ASSERT_OK_AND_ASSIGN(const Image smooth, RenderFoveated(super_voxels, Matrix4{}, settings));
      std::printf("%s azimuth %g rate %g: PSNR unsmoothed %.2f smoothed %.2f dB; border ratios",
                  name.c_str(), azimuth, rate, Psnr(blocks, full), Psnr(smooth, full));
      EXPECT_GT(Psnr(smooth, full), Psnr(blocks, full) - allowed_loss_db);
      for (int64_t width = 2; width <= set.hierarchy.WidthAt(0); width *= 2) {
        const double own = BorderRatio(full, shear, width, fovea, rate);
        const double before = BorderRatio(blocks, shear, width, fovea, rate) / own;
        const double after = BorderRatio(smooth, shear, width, fovea, rate) / own;
        std::printf(" %d: %.2f -> %.2f", static_cast<int>(width), before, after);
        EXPECT_LT(after, 1.2) << "pixels " << width << " voxels wide";
      }
      std::printf("\n");
    }
  }
}

TEST(PictureQualityTest, APlumeStepComesCloserAndShowsNoBlocks) {
  const std::string store = ::testing::TempDir() + "/picture_quality_plume.zarr";
  std::filesystem::remove_all(store);
  ingest::IngestOptions options;
  options.inputs = {FOVEA_SOURCE_DIR "/tests/data/plume/plume_0041.vdb"};
  options.grids = {"density"};
  options.output = store;
  ASSERT_OK(ingest::Ingest(options));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(store));
  ASSERT_OK_AND_ASSIGN(const auto step, dataset->OpenStep(0, "density", store::OnDamage::kFail));
  ASSERT_OK_AND_ASSIGN(const Grid voxels,
                       ExtractVoxels(*step, Box3::OfSize(dataset->info().hierarchy.dims())));
  CheckPictures("plume", voxels, {8, 16}, 0);
  std::filesystem::remove_all(store);
}

class RealPictureTest : public ::testing::TestWithParam<RealVolume> {};

TEST_P(RealPictureTest, ComesCloserAndShowsNoBlocks) {
  const Grid voxels = Load(GetParam());
  if (!HasFailure()) {
    CheckPictures(GetParam().name, voxels, {25, 40}, GetParam().allowed_loss_db);
  }
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RealPictureTest);
INSTANTIATE_TEST_SUITE_P(SharedVolumes, RealPictureTest, ::testing::ValuesIn(RealVolumes()),
                         [](const auto& p) { return p.param.name; });

}  // namespace
}  // namespace fovea::render
