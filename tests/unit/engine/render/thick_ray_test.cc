// The identities of the method: brute force on the foveated volume, full resolution when
// everything is kept, and a uniform volume that stays uniform.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/renderer.h"
#include "tests/support/pictures.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::render {
namespace {

using testing::Colorful;
using testing::LargestDifference;
using testing::LargestValue;
using testing::MakeCoefficients;
using testing::MakeGrid;
using testing::MakeSuperVoxels;
using testing::MakeWavyGrid;
using testing::Oblique;

/// Equation (3) for one ray along an axis, in double, straight from its definition: no table, no
/// sheared grid. Returns premultiplied R, G, B and the cover.
std::array<double, 4> BruteForceRay(const Grid& volume, const TransferFunction& transfer, int axis,
                                    bool ascending, Int3 at) {
  std::array<double, 4> sum{};
  double transmitted = 1;
  const int64_t count = volume.box.hi[axis];
  for (int64_t n = 0; n < count; ++n) {
    at[axis] = ascending ? n : count - 1 - n;
    const double value = volume.At(at.x, at.y, at.z);
    const auto& points = transfer.points;
    size_t i = 0;
    while (i + 2 < points.size() && value > points[i + 1].value) {
      ++i;
    }
    const auto& p = points[i];
    const auto& q = points[i + 1];
    const double f = std::clamp((value - p.value) / (q.value - p.value), 0.0, 1.0);
    const auto mix = [f](double a, double b) { return a + f * (b - a); };
    const double alpha = mix(p.opacity, q.opacity);
    sum[0] += transmitted * alpha * mix(p.color.red, q.color.red);
    sum[1] += transmitted * alpha * mix(p.color.green, q.color.green);
    sum[2] += transmitted * alpha * mix(p.color.blue, q.color.blue);
    transmitted *= 1 - alpha;
  }
  sum[3] = 1 - transmitted;
  return sum;
}

/// A view along an axis with one pixel a voxel, and where each pixel's ray runs.
struct AxisView {
  OrthographicView view;
  int axis;
  bool ascending;
};

std::vector<AxisView> AxisViews() {
  return {{{0, 0, {}, {}}, 0, true},    {{180, 0, {}, {}}, 0, false}, {{90, 0, {}, {}}, 1, true},
          {{-90, 0, {}, {}}, 1, false}, {{0, 90, {}, {}}, 2, true},   {{0, -90, {}, {}}, 2, false}};
}

/// The voxel column that pixel (i, j) looks along, in a size x size picture of one voxel a pixel
/// around the voxel corner `centre`.
Int3 ColumnOf(const AxisView& axis_view, const Int3& centre, int size, int i, int j) {
  const double sign = axis_view.ascending ? 1 : -1;
  const Vec3 up = axis_view.axis == 2 ? Vec3{0, 1, 0} : Vec3{0, 0, 1};
  const Vec3 sight{axis_view.axis == 0 ? sign : 0, axis_view.axis == 1 ? sign : 0,
                   axis_view.axis == 2 ? sign : 0};
  const Vec3 right = Cross(sight, up);
  Int3 at;
  for (int a = 0; a < 3; ++a) {
    const double place = (i + 0.5 - size / 2.0) * right[a] - (j + 0.5 - size / 2.0) * up[a];
    at[a] = centre[a] + static_cast<int64_t>(std::floor(place));
  }
  at[axis_view.axis] = 0;
  return at;
}

/// The largest difference of a picture from brute force; adds the pixels compared to `compared`.
double WorstAgainstBruteForce(const Image& image, const Grid& volume, const Int3& centre,
                              const TransferFunction& transfer, const AxisView& axis_view,
                              int64_t* compared) {
  double worst = 0;
  for (int j = 0; j < image.height; ++j) {
    for (int i = 0; i < image.width; ++i) {
      const Int3 column = ColumnOf(axis_view, centre, image.width, i, j);
      if (!volume.box.Contains(column)) {
        continue;
      }
      const auto expected =
          BruteForceRay(volume, transfer, axis_view.axis, axis_view.ascending, column);
      for (int c = 0; c < 4; ++c) {
        const size_t at = 4 * (static_cast<size_t>(j) * image.width + i) + c;
        worst = std::max(worst, std::abs(expected[c] - image.rgba[at]));
      }
      ++*compared;
    }
  }
  return worst;
}

TEST(ThickRayTest, EqualsBruteForceOnTheFoveatedVolumeAlongEveryAxis) {
  const std::vector<Int3> sizes = {{64, 64, 64}, {50, 38, 46}, {37, 70, 21}};
  std::mt19937 random(7);
  for (const Int3& dims : sizes) {
    const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
    MemorySource source(set);
    const Int3 centre{dims.x / 2, dims.y / 2, dims.z / 2};
    for (const double rate : {1.0, 3.0, 6.0, 13.0, 30.0}) {
      Fovea fovea{{}, rate};
      for (int axis = 0; axis < 3; ++axis) {
        std::uniform_real_distribution<> place(0, static_cast<double>(dims[axis]));
        fovea.at[axis] = place(random);
      }
      const RetainedSet retained = RetainedSet::Make(set.hierarchy, fovea).value();
      const Grid foveated = ExtractVoxels(source, Box3::OfSize(dims), &retained).value();
      const SuperVoxels super_voxels = Reconstruct(source, retained, 1).value();
      for (const AxisView& axis_view : AxisViews()) {
        RenderSettings settings;
        settings.view = axis_view.view;
        settings.view.center_voxels = {static_cast<double>(centre.x), static_cast<double>(centre.y),
                                       static_cast<double>(centre.z)};
        settings.view.span_voxels = 76;
        settings.width_px = settings.height_px = 76;
        settings.transfer = Colorful();
        settings.smoothing = Smoothing::kNone;
        settings.spent_transmittance = 0;
        ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(super_voxels, Matrix4{}, settings));
        int64_t compared = 0;
        const double worst = WorstAgainstBruteForce(image, foveated, centre, settings.transfer,
                                                    axis_view, &compared);
        EXPECT_EQ(compared, dims.Product() / dims[axis_view.axis]);
        EXPECT_LT(worst, 1e-5 * std::max(1.0, LargestValue(image)))
            << "dims " << dims.x << "," << dims.y << "," << dims.z << " rate " << rate << " fovea "
            << fovea.at.x << "," << fovea.at.y << "," << fovea.at.z << " axis " << axis_view.axis
            << (axis_view.ascending ? "+" : "-");
      }
    }
  }
}

TEST(ThickRayTest, EverythingKeptEqualsFullResolutionFromAnyDirection) {
  const Grid volume = MakeWavyGrid({45, 37, 51});
  const CoefficientSet set = MakeCoefficients(volume);
  const SuperVoxels everything = MakeSuperVoxels(set, {{20, 20, 20}, 51});
  std::mt19937 random(11);
  for (int trial = 0; trial < 24; ++trial) {
    RenderSettings settings;
    settings.view.azimuth_deg = std::uniform_real_distribution<>(-180, 180)(random);
    settings.view.elevation_deg = std::uniform_real_distribution<>(-90, 90)(random);
    settings.view.span_voxels = trial % 3 == 0 ? 30 : 80;  // zoomed in, and all of it
    settings.transfer = Colorful();
    settings.width_px = 90;
    settings.height_px = 70;
    settings.spent_transmittance = 0;
    settings.weighting.kind = static_cast<Weighting::Kind>(trial % 3);
    settings.weighting.falloff_per_voxel = 0.1;
    const Matrix4 matrix = trial % 2 == 0 ? Matrix4{} : Oblique();
    ASSERT_OK_AND_ASSIGN(const Image expected,
                         RenderReference(volume, matrix, {20, 20, 20}, settings));
    EXPECT_GT(LargestValue(expected), 0.5);
    for (const Smoothing smoothing : {Smoothing::kNone, Smoothing::kImage, Smoothing::kFull}) {
      settings.smoothing = smoothing;
      ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(everything, matrix, settings));
      EXPECT_LT(LargestDifference(image, expected), 1e-5)
          << "azimuth " << settings.view.azimuth_deg << " elevation " << settings.view.elevation_deg
          << " trial " << trial;
    }
  }
}

/// The renderers that speed is measured against draw the same picture.
TEST(ThickRayTest, FullResolutionRenderersAgree) {
  const Grid volume = MakeWavyGrid({40, 45, 51});
  RenderSettings settings;
  settings.transfer = Colorful();
  settings.width_px = settings.height_px = 80;
  for (const OrthographicView& view :
       {OrthographicView{0, 0, {}, {}}, OrthographicView{20, 60, {}, {}},
        OrthographicView{100, -30, {}, {}}}) {
    settings.view = view;
    settings.spent_transmittance = 0;
    ASSERT_OK_AND_ASSIGN(const Image expected,
                         RenderReference(volume, Oblique(), {20, 20, 20}, settings));
    ASSERT_OK_AND_ASSIGN(const Image plain, RenderPlainLoops(volume, Oblique(), settings));
    EXPECT_LT(LargestDifference(plain, expected), 1e-3);  // a table's error
    const SuperVoxels whole = WholeVolume(volume, {20, 20, 20}, 1);
    ASSERT_OK_AND_ASSIGN(const Image fast, RenderFoveated(whole, Oblique(), settings));
    EXPECT_LT(LargestDifference(fast, expected), 1e-5);
    settings.spent_transmittance = 1.0F / 4096;
    ASSERT_OK_AND_ASSIGN(const Image skipping, RenderFoveated(whole, Oblique(), settings));
    EXPECT_LT(LargestDifference(skipping, expected), 1.0 / 4096 + 1e-5);
  }
}

/// The pixels of a picture whose rays cross the volume from the near face to the far face, both at
/// least `margin` voxels from their edges.
std::vector<size_t> CrossingPixels(const ShearView& shear, const Int3& dims, double margin,
                                   int width, int height) {
  std::vector<size_t> pixels;
  const auto depth = static_cast<double>(dims[shear.axis_k]);
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      const auto& m = shear.warp;
      const double start[2] = {m[0] * i + m[1] * j + m[2], m[3] * i + m[4] * j + m[5]};
      const double slope[2] = {shear.slope_u, shear.slope_v};
      const int axis[2] = {shear.axis_u, shear.axis_v};
      bool inside = true;
      for (int a = 0; a < 2; ++a) {
        for (const double z : {0.0, depth}) {
          const double place = start[a] + slope[a] * z;
          inside = inside && place > margin && place < static_cast<double>(dims[axis[a]]) - margin;
        }
      }
      if (inside) {
        pixels.push_back(static_cast<size_t>(j) * width + i);
      }
    }
  }
  return pixels;
}

/// A slab across one axis, so that steep rays still cross it.
Int3 SlabAcross(int axis, int64_t n) {
  Int3 dims{n, n, n};
  dims[axis] = n / 4 + 1;  // not a multiple of anything: the far super-voxels overhang
  return dims;
}

TEST(ThickRayTest, UniformVolumeStaysUniform) {
  constexpr double kOpacity = 0.02;
  constexpr int kSize = 150;
  std::mt19937 random(3);
  for (int axis = 0; axis < 3; ++axis) {
    const Int3 dims = SlabAcross(axis, 150);
    const Grid volume(Box3::OfSize(dims), 0.5F);
    const CoefficientSet set = MakeCoefficients(volume);
    for (int trial = 0; trial < 8; ++trial) {
      // Slopes up to 1 in both directions, all signs, from both sides.
      Vec3 sight;
      for (int a = 0; a < 3; ++a) {
        sight[a] = std::uniform_real_distribution<>(-1, 1)(random);
      }
      sight[axis] = trial % 2 == 0 ? 1 : -1;
      sight = (1 / Length(sight)) * sight;
      RenderSettings settings;
      settings.view.azimuth_deg = std::atan2(sight.y, sight.x) * 180 / std::numbers::pi;
      settings.view.elevation_deg = std::asin(sight.z) * 180 / std::numbers::pi;
      settings.view.span_voxels = 150;
      settings.width_px = settings.height_px = kSize;
      settings.transfer = {{{0.5, {0.2F, 0.6F, 1.0F}, static_cast<float>(kOpacity)}}};
      const ShearView shear = FactorView(settings.view, dims, Matrix4{}, kSize, kSize);
      ASSERT_EQ(shear.axis_k, axis);
      const auto coarsest = static_cast<double>(set.hierarchy.WidthAt(0));
      const std::vector<size_t> pixels = CrossingPixels(shear, dims, coarsest, kSize, kSize);
      ASSERT_GE(pixels.size(), 500U);
      const double expected =
          1 - std::pow(1 - kOpacity, static_cast<double>(dims[axis]) * shear.step_length);
      for (const double rate : {2.0, 9.0, 24.0}) {
        Fovea fovea{{}, rate};
        for (int a = 0; a < 3; ++a) {
          fovea.at[a] = std::uniform_real_distribution<>(0, static_cast<double>(dims[a]))(random);
        }
        const SuperVoxels super_voxels = MakeSuperVoxels(set, fovea);
        for (const Smoothing smoothing : {Smoothing::kNone, Smoothing::kImage, Smoothing::kFull}) {
          settings.smoothing = smoothing;
          ASSERT_OK_AND_ASSIGN(const Image image,
                               RenderFoveated(super_voxels, Matrix4{}, settings));
          double worst = 0;
          for (const size_t pixel : pixels) {
            const float* p = &image.rgba[4 * pixel];
            worst = std::max({worst, std::abs(p[3] - expected), std::abs(p[0] - 0.2 * expected),
                              std::abs(p[2] - expected)});
          }
          EXPECT_LT(worst, 1e-4) << "axis " << axis << " slopes " << shear.slope_u << ","
                                 << shear.slope_v << " rate " << rate << " smoothing "
                                 << static_cast<int>(smoothing);
        }
      }
    }
  }
}

TEST(ThickRayTest, ThePictureDoesNotDependOnThreads) {
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid({70, 61, 80}));
  const SuperVoxels super_voxels = MakeSuperVoxels(set, {{30, 30, 40}, 12});
  RenderSettings settings;
  settings.view = {35, 20, {}, {}};
  settings.transfer = Colorful();
  settings.threads = 1;
  ASSERT_OK_AND_ASSIGN(const Image one, RenderFoveated(super_voxels, Matrix4{}, settings));
  for (const int threads : {2, 8}) {
    settings.threads = threads;
    ASSERT_OK_AND_ASSIGN(const Image many, RenderFoveated(super_voxels, Matrix4{}, settings));
    EXPECT_EQ(one.rgba, many.rgba) << threads << " threads";
  }
}

/// Chop hides everything before the fovea: what remains of a uniform volume is the path beyond.
TEST(ThickRayTest, ChopKeepsThePathBeyondTheFovea) {
  const Int3 dims{64, 64, 64};
  const CoefficientSet set = MakeCoefficients(Grid(Box3::OfSize(dims), 1.0F));
  RenderSettings settings;
  settings.view.span_voxels = 40;
  settings.width_px = settings.height_px = 20;
  settings.transfer = {{{1, {1, 1, 1}, 0.03F}}};
  settings.weighting.kind = Weighting::Kind::kChop;
  for (const double azimuth : {0.0, 180.0}) {
    settings.view.azimuth_deg = azimuth;
    for (const double at : {5.25, 31.0, 63.0}) {
      const SuperVoxels super_voxels = MakeSuperVoxels(set, {{at, 30, 30}, 8});
      ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(super_voxels, Matrix4{}, settings));
      const double path = azimuth == 0 ? 64 - at : at;
      const double expected = 1 - std::pow(1 - 0.03, path);
      for (size_t i = 3; i < image.rgba.size(); i += 4) {
        ASSERT_NEAR(image.rgba[i], expected, 1e-5) << "azimuth " << azimuth << " fovea x " << at;
      }
    }
  }
}

/// Falloff leaves the opacity at the fovea alone and weakens it with distance, as D says.
TEST(ThickRayTest, FalloffFollowsItsFormula) {
  const Int3 dims{48, 48, 48};
  const Grid volume(Box3::OfSize(dims), 1.0F);
  const CoefficientSet set = MakeCoefficients(volume);
  const Vec3 fovea{20, 24.5, 24.5};
  RenderSettings settings;
  settings.view.center_voxels = fovea;
  settings.view.span_voxels = 3;
  settings.width_px = settings.height_px = 3;  // the middle pixel looks at the fovea
  settings.transfer = {{{1, {1, 1, 1}, 0.1F}}};
  settings.weighting = {Weighting::Kind::kFalloff, 0.3};
  const SuperVoxels super_voxels = MakeSuperVoxels(set, {fovea, 48});
  ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(super_voxels, Matrix4{}, settings));
  double transmitted = 1;
  for (int x = 0; x < 48; ++x) {
    transmitted *= 1 - 0.1 / (1 + 0.3 * std::abs(x + 0.5 - fovea.x));
  }
  EXPECT_NEAR(image.rgba[4 * 4 + 3], 1 - transmitted, 1e-5);
}

}  // namespace
}  // namespace fovea::render
