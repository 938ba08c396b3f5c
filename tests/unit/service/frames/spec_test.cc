#include <cmath>
#include <limits>

#include "service/frames/frames.h"
#include "tests/support/fake_dataset.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::FakeDataset;
using ::testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(ValidateSpec, AcceptsNothingSaidAndTheEndsOfTheRanges) {
  EXPECT_OK(ValidateSpec({}));
  FrameSpec spec;
  spec.rate = 65536;
  spec.width_px = 16384;
  spec.height_px = 1;
  spec.jpeg_quality = 100;
  spec.view.elevation_deg = -90;
  spec.background = render::Color{0, 1, 0.5F};
  spec.weighting = render::Weighting{render::Weighting::Kind::kFalloff, 1e6};
  EXPECT_OK(ValidateSpec(spec));
}

TEST(ValidateSpec, NamesTheFieldItsValueAndItsRange) {
  const auto fails = [](auto&& set, const std::string& text) {
    FrameSpec spec;
    set(&spec);
    EXPECT_THAT(ValidateSpec(spec), FailsWith(kInvalid, text));
  };
  fails([](FrameSpec* s) { s->rate = 0; }, "rate 0 is outside its range, 1 to 65536");
  fails([](FrameSpec* s) { s->rate = kNan; }, "rate nan");
  fails([](FrameSpec* s) { s->rate = kInfinity; }, "rate inf");
  fails([](FrameSpec* s) { s->width_px = 100000; },
        "width_px 100000 is outside its range, 1 to 16384");
  fails([](FrameSpec* s) { s->height_px = 0; }, "height_px 0");
  fails([](FrameSpec* s) { s->jpeg_quality = 101; }, "jpeg_quality 101");
  fails([](FrameSpec* s) { s->fovea = Position{{1, kNan, 2}}; }, "fovea nan");
  fails([](FrameSpec* s) { s->view.center = Position{{1, 2, -kInfinity}}; }, "center -inf");
  fails([](FrameSpec* s) { s->view.azimuth_deg = kNan; }, "azimuth_deg nan");
  fails([](FrameSpec* s) { s->view.elevation_deg = 90.5; }, "elevation_deg 90.5");
  fails([](FrameSpec* s) { s->view.span_voxels = 0; }, "span_voxels 0");
  fails([](FrameSpec* s) { s->view.span_voxels = kNan; }, "span_voxels nan");
  const auto camera = [](FrameSpec* s) -> PerspectiveSpec& {
    return s->view.perspective.emplace(PerspectiveSpec{{{-9, 0, 0}}, {}, {}, {}});
  };
  fails([&](FrameSpec* s) { camera(s).eye.at.y = kNan; }, "eye nan");
  fails([&](FrameSpec* s) { camera(s).target = Position{{kInfinity, 0, 0}}; }, "target inf");
  fails([&](FrameSpec* s) { camera(s).up = Vec3{0, 0, kNan}; }, "up nan");
  fails([&](FrameSpec* s) { camera(s).up = Vec3{}; }, "up 0,0,0");
  fails([&](FrameSpec* s) { camera(s).fov_y_deg = 0; }, "fov_y_deg 0 is outside");
  fails([&](FrameSpec* s) { camera(s).fov_y_deg = 180; }, "fov_y_deg 180");
  fails(
      [&](FrameSpec* s) {
        camera(s);
        s->view.span_voxels = 3;
      },
      "eye: a perspective view has neither");
  fails([](FrameSpec* s) { s->background = render::Color{0, 1.5F, 0}; }, "background 1.5");
  fails([](FrameSpec* s) { s->transfer = render::TransferFunction{}; }, "transfer_function");
  fails(
      [](FrameSpec* s) {
        s->weighting = render::Weighting{render::Weighting::Kind::kFalloff, kNan};
      },
      "falloff_per_voxel nan");
}

TEST(DefaultSpec, LeavesNothingOpenAndLooksAtTheFullestStep) {
  FakeDataset dataset(5);
  ASSERT_OK_AND_ASSIGN(const FrameSpec spec, DefaultSpec(dataset));
  EXPECT_EQ(spec.field, "density");
  EXPECT_EQ(spec.width_px, 512);
  EXPECT_EQ(spec.rate, 40);
  EXPECT_EQ(spec.view.center, (Position{{20, 16, 24}}));
  EXPECT_NEAR(*spec.view.span_voxels, std::sqrt(40. * 40 + 32 * 32 + 48 * 48), 1e-9);
  // The ball is largest in the last step, at 20, 16, 28; a coarsest super-voxel is 4 wide.
  EXPECT_NEAR(spec.fovea->at.x, 20, 4);
  EXPECT_NEAR(spec.fovea->at.y, 16, 4);
  EXPECT_NEAR(spec.fovea->at.z, 28, 4);
  EXPECT_OK(ValidateSpec(spec));
  EXPECT_EQ(*ResolveSpec(dataset, {}, spec), spec);
}

TEST(DefaultSpec, NeedsAStep) {
  FakeDataset dataset(0);
  EXPECT_THAT(DefaultSpec(dataset),
              FailsWith(absl::StatusCode::kFailedPrecondition, "no committed step"));
}

TEST(ResolveSpec, KeepsWhatWasSaidAndFillsInTheRest) {
  FakeDataset dataset(3);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.rate = 12;
  spec.view.azimuth_deg = 30;
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  EXPECT_EQ(resolved.rate, 12);
  EXPECT_EQ(resolved.view.azimuth_deg, 30);
  EXPECT_EQ(resolved.view.elevation_deg, defaults.view.elevation_deg);
  EXPECT_EQ(resolved.fovea, defaults.fovea);
  EXPECT_EQ(resolved.transfer, defaults.transfer);
}

TEST(ResolveSpec, FillsInAPerspectiveView) {
  FakeDataset dataset(1);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.view.perspective = PerspectiveSpec{{{10, 20, 30}, true}, {}, {}, {}};
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  ASSERT_TRUE(resolved.view.perspective);
  EXPECT_EQ(*resolved.view.perspective,
            (PerspectiveSpec{{{0, 0, 0}}, Position{{20, 16, 24}}, Vec3{0, 0, 1}, 45}));
  EXPECT_FALSE(resolved.view.azimuth_deg || resolved.view.center || resolved.view.span_voxels);
  EXPECT_EQ(*ResolveSpec(dataset, resolved, defaults), resolved);
  spec.view.perspective = PerspectiveSpec{{{20, 16, 200}}, {}, {}, 30};  // straight down
  EXPECT_EQ(ResolveSpec(dataset, spec, defaults)->view.perspective->up, (Vec3{0, 1, 0}));
  spec.view.perspective->up = Vec3{0, 0, 2};
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults), FailsWith(kInvalid, "up 0, 0, 2 is parallel"));
  spec.view.perspective = PerspectiveSpec{{{20, 16, 24}}, {}, {}, {}};
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults),
              FailsWith(kInvalid, "target 20, 16, 24 is the eye itself"));
}

TEST(ResolveSpec, TurnsWorldPositionsIntoVoxels) {
  FakeDataset dataset(1);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.fovea = Position{{50, 52, 78}, true};
  spec.view.center = Position{{10, 20, 30}, true};
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  EXPECT_EQ(resolved.fovea, (Position{{20, 16, 24}}));
  EXPECT_EQ(resolved.view.center, (Position{{0, 0, 0}}));
}

TEST(ResolveSpec, RefusesAFoveaOutsideButNotOnTheBorder) {
  FakeDataset dataset(1);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.fovea = Position{{40, 32, 48}};
  EXPECT_OK(ResolveSpec(dataset, spec, defaults));
  spec.fovea = Position{{20, 16, 48.5}};
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults),
              FailsWith(kInvalid, "fovea 20, 16, 48.5 is outside"));
  spec.fovea = Position{{0, 0, 0}, true};
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults), FailsWith(kInvalid, "(world 0, 0, 0)"));
}

TEST(ResolveSpec, TurnsWorldClippingIntoVoxels) {
  FakeDataset dataset(1);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.clip.box = ClipBox{{50, 52, 78}, {60, 60, 90}, true};
  spec.clip.planes = {{{1, 0, 0}, 50, true}, {{0, 1, 0}, 3, false}};
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  EXPECT_EQ(resolved.clip.box, (ClipBox{{20, 16, 24}, {25, 20, 30}}));
  ASSERT_EQ(resolved.clip.planes.size(), 2U);
  EXPECT_EQ(resolved.clip.planes[0], (ClipPlane{{2, 0, 0}, 40}));
  EXPECT_EQ(resolved.clip.planes[1], spec.clip.planes[1]);
}

TEST(ResolveSpec, AWorldBoxBecomesPlanesWhereTheAxesAreTurned) {
  FakeDataset dataset(1);
  Matrix4 turned;
  turned.m = {0.8, -0.6, 0, 3, 0.6, 0.8, 0, -5, 0, 0, 2, 1, 0, 0, 0, 1};
  dataset.set_index_to_world(turned);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.clip.box = ClipBox{{5, 8, 9}, {14, 20, 60}, true};
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  EXPECT_FALSE(resolved.clip.box.has_value());
  ASSERT_EQ(resolved.clip.planes.size(), 6U);
  const ClipBox& box = *spec.clip.box;
  int inside_count = 0;
  for (int i = 0; i < 1000; ++i) {
    const Vec3 p{0.37 + 4.0 * (i % 10), 0.11 + 3.2 * (i / 10 % 10), 0.23 + 4.8 * (i / 100)};
    const Vec3 world = turned.TransformPoint(p);
    bool inside = true;
    bool kept = true;
    for (int axis = 0; axis < 3; ++axis) {
      inside = inside && world[axis] >= box.lower[axis] && world[axis] <= box.upper[axis];
    }
    for (const ClipPlane& plane : resolved.clip.planes) {
      kept = kept && Dot(plane.normal, p) >= plane.offset;
    }
    EXPECT_EQ(kept, inside) << i;
    inside_count += inside ? 1 : 0;
  }
  EXPECT_GT(inside_count, 20);
  spec.clip.planes = {{{1, 0, 0}, 0}};
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults), FailsWith(kInvalid, "clip_box in world units"));
}

TEST(ResolveSpec, ASecondFieldGetsATransferFunctionOfItsOwn) {
  FakeDataset dataset(2);
  const FrameSpec defaults = *DefaultSpec(dataset);
  EXPECT_FALSE(defaults.color_field.has_value());
  FrameSpec spec;
  spec.color_field = "warm";
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  EXPECT_EQ(resolved.transfer, defaults.transfer);
  FrameSpec warm;
  warm.field = "warm";
  EXPECT_EQ(resolved.color_transfer, ResolveSpec(dataset, warm, defaults)->transfer);
  spec.color_field = "colour";
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults),
              FailsWith(absl::StatusCode::kNotFound, "color_field 'colour'"));
}

TEST(ResolveSpec, LeavesNoModeOpen) {
  FakeDataset dataset(1);
  const FrameSpec defaults = *DefaultSpec(dataset);
  EXPECT_EQ(defaults.mode, Mode::kTwoPhase);
  FrameSpec spec;
  spec.mode = Mode::kAuto;
  EXPECT_EQ(ResolveSpec(dataset, spec, defaults)->mode, Mode::kFused);
  dataset.set_wavelet("cdf53");
  EXPECT_EQ(ResolveSpec(dataset, spec, defaults)->mode, Mode::kTwoPhase);
  spec.mode = Mode::kFused;
  EXPECT_THAT(ResolveSpec(dataset, spec, defaults),
              FailsWith(kInvalid, "this dataset's are cdf53"));
}

TEST(ResolveSpec, AnotherFieldGetsItsOwnFoveaAndTransferFunction) {
  FakeDataset dataset(2);
  const FrameSpec defaults = *DefaultSpec(dataset);
  FrameSpec spec;
  spec.field = "warm";
  ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
  EXPECT_NEAR(resolved.fovea->at.x, 10, 4);
  EXPECT_GT(resolved.transfer->points.back().value, 50);
  spec.field = "colour";
  const auto unknown = ResolveSpec(dataset, spec, defaults);
  EXPECT_THAT(unknown, FailsWith(absl::StatusCode::kNotFound, "field 'colour'"));
  EXPECT_THAT(std::string(MessageOf(unknown.status())), HasSubstr("density, warm"));
}

}  // namespace
}  // namespace fovea::frames
