// Lighting, maxima, clipping and a second field: against the reference when everything is kept, and
// against what must come out by analysis.
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/lighting.h"
#include "engine/render/renderer.h"
#include "tests/support/pictures.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::render {
namespace {

using testing::Colorful;
using testing::FailsWith;
using testing::LargestDifference;
using testing::MakeCoefficients;
using testing::MakeGrid;
using testing::MakeSuperVoxels;
using testing::MakeWavyGrid;
using testing::Oblique;

struct Option {
  std::string name;
  std::function<void(RenderSettings*)> set;
  bool second_field = false;
};

std::vector<Option> Options() {
  return {
      {"lighting", [](RenderSettings* s) { s->lighting.enabled = true; }},
      {"lighting from the side",
       [](RenderSettings* s) {
         s->lighting = {true, 0.1F, 0.5F, 0.6F, 4, {1, -2, 0.5}};
       }},
      {"maximum", [](RenderSettings* s) { s->compositing = Compositing::kMaximum; }},
      {"maximum, clipped",
       [](RenderSettings* s) {
         s->compositing = Compositing::kMaximum;
         s->clip.planes = {{{1, 1, 0.5}, 50}};
       }},
      {"clip box",
       [](RenderSettings* s) {
         s->clip.box = {{Vec3{5.3, 7, -10}, Vec3{30, 33.3, 40.7}}};
       }},
      {"clip planes with falloff",
       [](RenderSettings* s) {
         s->clip.planes = {{{1, 0.4, -0.2}, 15}, {{0, 0, -2}, -70}};
         s->weighting = {Weighting::Kind::kFalloff, 0.05};
       }},
      {"chop and clip plane",
       [](RenderSettings* s) {
         s->clip.planes = {{{-1, 0, 1}, -5}};
         s->weighting.kind = Weighting::Kind::kChop;
       }},
      {"second field",
       [](RenderSettings* s) {
         s->color_transfer = {{{-1, {1, 0, 0}, 0}, {0, {0, 1, 0}, 0}, {1, {0, 0, 1}, 0}}};
       },
       true},
      {"second field from a table, lit",
       [](RenderSettings* s) {
         for (int i = 0; i < 40; ++i) {
           const float f = static_cast<float>(i) / 39;
           s->color_transfer.points.push_back({2 * f - 1, {f, 1 - f, f * f}, 0});
         }
         s->lighting.enabled = true;
       },
       true},
  };
}

TEST(RenderOptionsTest, EverythingKeptEqualsFullResolution) {
  const Grid volume = MakeWavyGrid({45, 37, 51});
  const Grid second = MakeGrid({45, 37, 51}, [](double x, double y, double z) {
    return std::sin(0.2 * x) * std::cos(0.15 * y + 0.1 * z);
  });
  const Fovea all{{20, 20, 20}, 51};
  const SuperVoxels everything = MakeSuperVoxels(MakeCoefficients(volume), all);
  const SuperVoxels second_everything = MakeSuperVoxels(MakeCoefficients(second), all);
  std::mt19937 random(5);
  for (const Option& option : Options()) {
    for (int trial = 0; trial < 6; ++trial) {
      RenderSettings settings;
      settings.view.azimuth_deg = std::uniform_real_distribution<>(-180, 180)(random);
      settings.view.elevation_deg = std::uniform_real_distribution<>(-90, 90)(random);
      settings.view.span_voxels = 80;
      settings.transfer = Colorful();
      settings.width_px = settings.height_px = 70;
      settings.spent_transmittance = 0;
      settings.smoothing = static_cast<Smoothing>(trial % 3);
      option.set(&settings);
      const Matrix4 matrix = trial % 2 == 0 ? Matrix4{} : Oblique();
      ASSERT_OK_AND_ASSIGN(const Image expected,
                           RenderReference(volume, matrix, all.at, settings, nullptr,
                                           option.second_field ? &second : nullptr));
      ASSERT_OK_AND_ASSIGN(const Image image,
                           RenderFoveated(everything, matrix, settings, nullptr,
                                          option.second_field ? &second_everything : nullptr));
      // A table is as exact as its steps.
      const double tolerance = settings.color_transfer.points.size() > 30 ? 2e-3 : 2e-5;
      EXPECT_LT(LargestDifference(image, expected), tolerance) << option.name << " trial " << trial;
      EXPECT_GT(*std::max_element(image.rgba.begin(), image.rgba.end()), 0.2) << option.name;
    }
  }
}

/// What remains of a uniform volume in a box is the path through the box.
TEST(RenderOptionsTest, AClipBoxLeavesThePathThroughIt) {
  const SuperVoxels volume =
      MakeSuperVoxels(MakeCoefficients(Grid(Box3::OfSize({64, 64, 64}), 1.0F)), {{20, 30, 40}, 9});
  RenderSettings settings;
  settings.transfer = {{{1, {1, 1, 1}, 0.03F}}};
  settings.clip.box = {{Vec3{10.25, 20, 20}, Vec3{43.5, 50, 50}}};
  settings.view = {0, 0, Vec3{32, 35, 35}, 8.0};  // along x, well inside the box
  settings.width_px = settings.height_px = 20;
  ASSERT_OK_AND_ASSIGN(const Image along, RenderFoveated(volume, Matrix4{}, settings));
  for (size_t i = 3; i < along.rgba.size(); i += 4) {
    ASSERT_NEAR(along.rgba[i], 1 - std::pow(0.97, 33.25), 1e-4);
  }
  settings.view = {30, 0, Vec3{27, 35, 35}, 2.0};  // at 30 degrees, in and out by the x faces
  settings.width_px = settings.height_px = 3;
  ASSERT_OK_AND_ASSIGN(const Image oblique, RenderFoveated(volume, Matrix4{}, settings));
  EXPECT_NEAR(oblique.rgba[4 * 4 + 3], 1 - std::pow(0.97, 33.25 / std::cos(30 * 3.14159265 / 180)),
              1e-4);
}

/// Along an axis, unsmoothed, the maximum is that of the foveated volume's columns.
TEST(RenderOptionsTest, MaximumIsThatOfTheFoveatedVolume) {
  const Int3 dims{40, 48, 64};
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
  MemorySource source(set);
  const RetainedSet retained = RetainedSet::Make(set.hierarchy, {{15, 20, 30}, 7}).value();
  const Grid foveated = ExtractVoxels(source, Box3::OfSize(dims), &retained).value();
  RenderSettings settings;
  settings.compositing = Compositing::kMaximum;
  settings.smoothing = Smoothing::kNone;
  settings.transfer = {{{0, {1, 1, 1}, 0.0F}, {1, {1, 1, 1}, 1.0F}}};  // cover = value
  settings.view = {0, 90, {}, 48.0};                                   // along z, +y up
  settings.width_px = 40;
  settings.height_px = 48;
  ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(Reconstruct(source, retained, 1).value(),
                                                         Matrix4{}, settings));
  for (int64_t j = 0; j < 48; ++j) {
    for (int64_t i = 0; i < 40; ++i) {
      // Looking along +z with +y up, x grows to the left.
      float most = -1;
      for (int64_t z = 0; z < 64; ++z) {
        most = std::max(most, foveated.At(39 - i, 47 - j, z));
      }
      ASSERT_NEAR(image.rgba[static_cast<size_t>(4 * (j * 40 + i) + 3)], most, 1e-5)
          << i << "," << j;
    }
  }
}

TEST(RenderOptionsTest, LightFromTheViewerShadesABall) {
  const Grid ball = MakeGrid({64, 64, 64}, [](double x, double y, double z) {
    const double r = Length(Vec3{x, y, z} - Vec3{32, 32, 32});
    return std::clamp((24 - r) / 4 + 0.5, 0.0, 1.0);
  });
  RenderSettings settings;
  settings.transfer = {{{0, {0.5F, 0.5F, 0.5F}, 0}, {1, {0.5F, 0.5F, 0.5F}, 0.9F}}};
  settings.view.span_voxels = 64;
  settings.width_px = settings.height_px = 64;
  settings.lighting = {true, 0.1F, 0.9F, 0.0F, 16, {}};
  for (const double rate : {64.0, 16.0}) {  // fine and coarse super-voxels are lit alike
    ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(MakeSuperVoxels(MakeCoefficients(ball),
                                                                           {{32, 32, 32}, rate}),
                                                           Matrix4{}, settings));
    const auto red = [&](int i, int j) {
      return image.rgba[static_cast<size_t>(4 * (64 * j + i))];
    };
    EXPECT_GT(red(32, 32), 0.40) << "rate " << rate;                // faces the light
    EXPECT_LT(red(53, 32), 0.62 * red(32, 32)) << "rate " << rate;  // turned away by 60 degrees
    EXPECT_NEAR(red(53, 32), red(10, 32), 0.04) << "rate " << rate;
    EXPECT_NEAR(red(32, 53), red(32, 10), 0.04) << "rate " << rate;
  }
}

/// A gradient is a covector: with voxels twice as deep as wide, the plane x + z = const of the
/// index faces (1, 0, 1/2) in the world.
TEST(RenderOptionsTest, NormalsAreThoseOfTheWorld) {
  Matrix4 matrix;
  matrix.m = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 2, 7, 0, 0, 0, 1};
  for (const OrthographicView& towards :
       {OrthographicView{0, 0, {}, {}}, OrthographicView{90, 0, {}, {}},
        OrthographicView{0, 90, {}, {}}}) {
    const ShearView view = FactorView(towards, {20, 20, 20}, matrix, 8, 8);
    const KernelLight light = MakeLight({}, Colorful(), view, matrix);
    Vec3 gradient;  // in (u, v, k)
    const int axes[3] = {view.axis_u, view.axis_v, view.axis_k};
    for (int i = 0; i < 3; ++i) {
      gradient[i] = axes[i] == 1 ? 0 : 1;
    }
    Vec3 world;
    for (int row = 0; row < 3; ++row) {
      for (int i = 0; i < 3; ++i) {
        world[row] += static_cast<double>(light.gradient_to_world[3 * row + i]) * gradient[i];
      }
    }
    EXPECT_NEAR(world.x, 1, 1e-6);
    EXPECT_NEAR(world.y, 0, 1e-6);
    EXPECT_NEAR(world.z, 0.5, 1e-6);
  }
}

TEST(RenderOptionsTest, FullAmbientLightChangesNothing) {
  const SuperVoxels volume =
      MakeSuperVoxels(MakeCoefficients(MakeWavyGrid({40, 40, 40})), {{10, 20, 20}, 8});
  RenderSettings settings;
  settings.transfer = Colorful();
  settings.view = {20, 30, {}, {}};
  ASSERT_OK_AND_ASSIGN(const Image plain, RenderFoveated(volume, Matrix4{}, settings));
  settings.lighting = {true, 1, 0, 0, 1, {}};
  ASSERT_OK_AND_ASSIGN(const Image lit, RenderFoveated(volume, Matrix4{}, settings));
  EXPECT_LT(LargestDifference(plain, lit), 1e-6);
}

TEST(RenderOptionsTest, BadOptionsAreNamed) {
  const SuperVoxels volume =
      MakeSuperVoxels(MakeCoefficients(MakeWavyGrid({20, 20, 20})), {{10, 10, 10}, 8});
  const auto failure = [&](const std::function<void(RenderSettings*)>& set) {
    RenderSettings settings;
    settings.transfer = Colorful();
    set(&settings);
    return RenderFoveated(volume, Matrix4{}, settings).status();
  };
  const float nan = std::nanf("");
  EXPECT_THAT(failure([&](auto* s) { s->lighting.diffuse = nan; }),
              FailsWith(absl::StatusCode::kInvalidArgument, "lighting.diffuse"));
  EXPECT_THAT(failure([](auto* s) { s->lighting.shininess = 3; }),
              FailsWith(absl::StatusCode::kInvalidArgument, "power of two"));
  EXPECT_THAT(failure([](auto* s) {
                s->clip.box = {{Vec3{5, 5, 5}, Vec3{4, 9, 9}}};
              }),
              FailsWith(absl::StatusCode::kInvalidArgument, "its x runs from 5 to 4"));
  EXPECT_THAT(failure([](auto* s) { s->clip.planes.resize(7); }),
              FailsWith(absl::StatusCode::kInvalidArgument, "at most 6"));
  EXPECT_THAT(failure([](auto* s) {
                s->clip.planes = {{{0, 0, 0}, 1}};
              }),
              FailsWith(absl::StatusCode::kInvalidArgument, "normal"));
  RenderSettings settings;
  settings.transfer = settings.color_transfer = Colorful();
  const SuperVoxels other =
      MakeSuperVoxels(MakeCoefficients(MakeWavyGrid({20, 20, 20})), {{9, 10, 10}, 5});
  EXPECT_THAT(RenderFoveated(volume, Matrix4{}, settings, nullptr, &other).status(),
              FailsWith(absl::StatusCode::kInvalidArgument, "another size or fovea"));
}

}  // namespace
}  // namespace fovea::render
