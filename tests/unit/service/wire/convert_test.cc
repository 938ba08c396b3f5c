#include "service/wire/convert.h"

#include <functional>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "service/wire/printable.h"
#include "service/wire/status.h"
#include "tests/support/status_matchers.h"

namespace fovea::wire {
namespace {

using ::fovea::testing::FailsWith;

frames::FrameSpec FullSpec() {
  frames::FrameSpec spec;
  spec.field = "density";
  spec.view = {12.5, -90.0, frames::Position{{1, 2.5, -3}, true}, 77.25, {}};
  spec.fovea = frames::Position{{4, 5, 6.125}, false};
  spec.rate = 40.5;
  spec.transfer = render::TransferFunction{
      {{-1.5, {0.25F, 0.5F, 1.0F}, 0.0F}, {0.1, {0.1F, 0.0F, 0.3F}, 0.7F}}};
  spec.weighting = render::Weighting{render::Weighting::Kind::kFalloff, 0.125};
  spec.smoothing = render::Smoothing::kImage;
  spec.width_px = 640;
  spec.height_px = 480;
  spec.encoding = frames::Encoding::kJpeg;
  spec.jpeg_quality = 75;
  spec.background = render::Color{0.5F, 0.25F, 1.0F};
  spec.fovea_marker = true;
  spec.strict = true;
  spec.compositing = render::Compositing::kEmissionAbsorption;
  spec.lighting = render::Lighting{true, 0.25F, 0.5F, 0.1F, 64, {1, -2.5, 0.1}};
  spec.clip.box = frames::ClipBox{{-1, 2.5, 3}, {4, 5, 6}, true};
  spec.clip.planes = {{{1, 0, 0.5}, -7.25, false}, {{0, -1, 0}, 3, true}};
  spec.color_field = "heat";
  spec.color_transfer = render::TransferFunction{{{0.5, {1, 0, 0.5F}, 0}, {2, {0, 1, 0}, 1}}};
  spec.mode = frames::Mode::kFused;
  return spec;
}

/// Through the bytes, as a peer sees it.
StatusOr<frames::FrameSpec> RoundTrip(const frames::FrameSpec& spec) {
  v1::FrameSpec proto;
  EXPECT_TRUE(proto.ParseFromString(ToProto(spec).SerializeAsString()));
  return FromProto(proto, "spec");
}

TEST(SpecTest, AFullSpecComesBackIdentical) {
  ASSERT_OK_AND_ASSIGN(const frames::FrameSpec back, RoundTrip(FullSpec()));
  EXPECT_EQ(back, FullSpec());
}

TEST(SpecTest, AnEmptySpecComesBackEmpty) {
  ASSERT_OK_AND_ASSIGN(const frames::FrameSpec back, RoundTrip({}));
  EXPECT_EQ(back, frames::FrameSpec{});
}

TEST(SpecTest, EveryEnumValueComesBack) {
  for (const auto encoding :
       {frames::Encoding::kPng, frames::Encoding::kJpeg, frames::Encoding::kRawRgba8,
        frames::Encoding::kRawRgbaF32, frames::Encoding::kFoveated}) {
    for (const auto smoothing :
         {render::Smoothing::kNone, render::Smoothing::kImage, render::Smoothing::kFull}) {
      for (const auto kind : {render::Weighting::Kind::kNone, render::Weighting::Kind::kChop,
                              render::Weighting::Kind::kFalloff}) {
        frames::FrameSpec spec;
        spec.encoding = encoding;
        spec.smoothing = smoothing;
        spec.weighting = render::Weighting{kind, 0};
        ASSERT_OK_AND_ASSIGN(const frames::FrameSpec back, RoundTrip(spec));
        EXPECT_EQ(back, spec);
      }
    }
  }
}

TEST(SpecTest, EveryWindowAndARateAnAxisSurviveTheRoundTrip) {
  for (const auto window : {WindowShape::kCube, WindowShape::kSphere, WindowShape::kSmooth}) {
    frames::FrameSpec spec;
    spec.window = window;
    spec.rate = {40, 12.5, 8};
    spec.reconstruction =
        window == WindowShape::kCube ? Reconstruction::kExact : Reconstruction::kFast;
    spec.basis = window == WindowShape::kCube ? render::Basis::kBspline : render::Basis::kBilinear;
    ASSERT_OK_AND_ASSIGN(const frames::FrameSpec back, RoundTrip(spec));
    EXPECT_EQ(back, spec);
  }
}

TEST(SpecTest, APerspectiveViewComesBackWithAndWithoutItsOptions) {
  frames::FrameSpec spec;
  spec.view.perspective = frames::PerspectiveSpec{{{1, -2, 3.5}, true}, {}, {}, {}};
  ASSERT_OK_AND_ASSIGN(frames::FrameSpec back, RoundTrip(spec));
  EXPECT_EQ(back, spec);
  spec.view.perspective->target = frames::Position{{4, 5, 6}};
  spec.view.perspective->up = Vec3{0, 1, 0.25};
  spec.view.perspective->fov_y_deg = 70;
  ASSERT_OK_AND_ASSIGN(back, RoundTrip(spec));
  EXPECT_EQ(back, spec);
}

TEST(SpecTest, EveryCompositingAndModeComesBack) {
  for (const auto compositing :
       {render::Compositing::kEmissionAbsorption, render::Compositing::kMaximum}) {
    for (const auto mode : {frames::Mode::kTwoPhase, frames::Mode::kFused, frames::Mode::kAuto}) {
      frames::FrameSpec spec;
      spec.compositing = compositing;
      spec.mode = mode;
      ASSERT_OK_AND_ASSIGN(const frames::FrameSpec back, RoundTrip(spec));
      EXPECT_EQ(back, spec);
    }
  }
}

TEST(SpecTest, LightingWithNothingSaidIsTheDefaultOne) {
  v1::FrameSpec proto;
  proto.mutable_lighting();
  ASSERT_OK_AND_ASSIGN(const frames::FrameSpec spec, FromProto(proto, "spec"));
  EXPECT_EQ(spec.lighting, (render::Lighting{true, 0.3F, 0.7F, 0.2F, 16, {}}));
}

TEST(SpecTest, AnglesLeftOutOfAGivenViewAreZero) {
  v1::FrameSpec proto;
  proto.mutable_view()->mutable_orthographic()->set_span_voxels(10);
  ASSERT_OK_AND_ASSIGN(const frames::FrameSpec spec, FromProto(proto, "spec"));
  EXPECT_EQ(spec.view.azimuth_deg, 0.0);
  EXPECT_EQ(spec.view.elevation_deg, 0.0);
  EXPECT_FALSE(spec.view.center.has_value());
}

struct BadSpec {
  const char* field;                   // where the error must point
  const char* text;                    // what its message must contain
  void (*spoil)(v1::FrameSpec* spec);  // makes a good spec bad
};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

const BadSpec kBadSpecs[] = {
    {"spec.rate", "1 to 65536", [](v1::FrameSpec* s) { s->set_rate(0); }},
    {"spec.rate", "65537", [](v1::FrameSpec* s) { s->set_rate(65537); }},
    {"spec.rate", "finite", [](v1::FrameSpec* s) { s->set_rate(kNan); }},
    {"spec.rate_xyz", "instead of",
     [](v1::FrameSpec* s) {
       s->set_rate(5);
       s->mutable_rate_xyz()->set_x(5);
     }},
    {"spec.rate_xyz", "0 is outside its range, 1 to 65536",
     [](v1::FrameSpec* s) {
       s->clear_rate();
       s->mutable_rate_xyz()->set_x(5);
     }},
    {"spec.reconstruction", "9",
     [](v1::FrameSpec* s) { s->set_reconstruction(v1::Reconstruction(9)); }},
    {"spec.basis", "9", [](v1::FrameSpec* s) { s->set_basis(v1::Basis(9)); }},
    {"spec.window", "9", [](v1::FrameSpec* s) { s->set_window(v1::WindowShape(9)); }},
    {"spec.width_px", "1 to 16384", [](v1::FrameSpec* s) { s->set_width_px(100'000); }},
    {"spec.width_px", "width_px 0", [](v1::FrameSpec* s) { s->set_width_px(0); }},
    {"spec.height_px", "4294967295", [](v1::FrameSpec* s) { s->set_height_px(0xFFFFFFFFU); }},
    {"spec.height_px", "67108864",
     [](v1::FrameSpec* s) {
       s->set_encoding(v1::RAW_RGBA_F32);
       s->set_width_px(2048);
       s->set_height_px(2049);
     }},
    {"spec.width_px", "67108864",
     [](v1::FrameSpec* s) {
       s->set_encoding(v1::RAW_RGBA8);
       s->set_width_px(16384);
       s->set_height_px(1025);
     }},
    {"spec.jpeg_quality", "1 to 100", [](v1::FrameSpec* s) { s->set_jpeg_quality(101); }},
    {"spec.encoding", "77", [](v1::FrameSpec* s) { s->set_encoding(v1::Encoding(77)); }},
    {"spec.smoothing", "9", [](v1::FrameSpec* s) { s->set_smoothing(v1::Smoothing(9)); }},
    {"spec.weighting.kind", "-1",
     [](v1::FrameSpec* s) { s->mutable_weighting()->set_kind(v1::Weighting::Kind(-1)); }},
    {"spec.weighting.falloff_per_voxel", "without kind FALLOFF",
     [](v1::FrameSpec* s) { s->mutable_weighting()->set_falloff_per_voxel(1); }},
    {"spec.weighting.falloff_per_voxel", "0 to 1",
     [](v1::FrameSpec* s) {
       s->mutable_weighting()->set_kind(v1::Weighting::FALLOFF);
       s->mutable_weighting()->set_falloff_per_voxel(-1);
     }},
    {"spec.view.perspective.eye", "is missing",
     [](v1::FrameSpec* s) { s->mutable_view()->mutable_perspective()->set_fov_y_deg(45); }},
    {"spec.view.perspective.fov_y_deg", "180 is outside its range, 0.01 to 170",
     [](v1::FrameSpec* s) {
       s->mutable_view()->mutable_perspective()->mutable_eye();
       s->mutable_view()->mutable_perspective()->set_fov_y_deg(180);
     }},
    {"spec.view.perspective.up", "finite",
     [](v1::FrameSpec* s) {
       s->mutable_view()->mutable_perspective()->mutable_eye();
       s->mutable_view()->mutable_perspective()->mutable_up()->set_y(kNan);
     }},
    {"spec.view.perspective.target.at", "finite",
     [](v1::FrameSpec* s) {
       s->mutable_view()->mutable_perspective()->mutable_eye();
       s->mutable_view()->mutable_perspective()->mutable_target()->mutable_at()->set_x(kInfinity);
     }},
    {"spec.view.orthographic.azimuth_deg", "finite",
     [](v1::FrameSpec* s) { s->mutable_view()->mutable_orthographic()->set_azimuth_deg(kNan); }},
    {"spec.view.orthographic.elevation_deg", "-90 to 90",
     [](v1::FrameSpec* s) { s->mutable_view()->mutable_orthographic()->set_elevation_deg(91); }},
    {"spec.view.orthographic.span_voxels", "above 0",
     [](v1::FrameSpec* s) { s->mutable_view()->mutable_orthographic()->set_span_voxels(0); }},
    {"spec.view.orthographic.center.at", "finite",
     [](v1::FrameSpec* s) {
       s->mutable_view()->mutable_orthographic()->mutable_center()->mutable_at()->set_y(kNan);
     }},
    {"spec.fovea.at", "finite",
     [](v1::FrameSpec* s) { s->mutable_fovea()->mutable_at()->set_x(kInfinity); }},
    {"spec.fovea.space", "SPACE_WORLD",
     [](v1::FrameSpec* s) { s->mutable_fovea()->set_space(v1::Space(3)); }},
    {"spec.transfer_function.points", "0 points",
     [](v1::FrameSpec* s) { s->mutable_transfer_function(); }},
    {"spec.transfer_function.points", "4097 points",
     [](v1::FrameSpec* s) {
       for (int i = 0; i < 4097; ++i) {
         s->mutable_transfer_function()->add_points();
       }
     }},
    {"spec.transfer_function.points[0]", "finite",
     [](v1::FrameSpec* s) {
       s->mutable_transfer_function()->add_points()->set_opacity(kInfinity);
     }},
    {"spec.transfer_function", "1.5",
     [](v1::FrameSpec* s) { s->mutable_transfer_function()->add_points()->set_opacity(1.5F); }},
    {"spec.compositing", "7", [](v1::FrameSpec* s) { s->set_compositing(v1::Compositing(7)); }},
    {"spec.mode", "-3", [](v1::FrameSpec* s) { s->set_mode(v1::Mode(-3)); }},
    {"spec.lighting", "ambient 1.5",
     [](v1::FrameSpec* s) { s->mutable_lighting()->set_ambient(1.5F); }},
    {"spec.lighting", "finite",
     [](v1::FrameSpec* s) { s->mutable_lighting()->set_diffuse(kInfinity); }},
    {"spec.lighting", "power of two",
     [](v1::FrameSpec* s) { s->mutable_lighting()->set_shininess(0); }},
    {"spec.lighting.shininess", "1 to 256",
     [](v1::FrameSpec* s) { s->mutable_lighting()->set_shininess(0xFFFFFFFFU); }},
    {"spec.lighting.to_light", "finite",
     [](v1::FrameSpec* s) { s->mutable_lighting()->mutable_to_light()->set_z(kNan); }},
    {"spec.lighting", "maximum",
     [](v1::FrameSpec* s) {
       s->mutable_lighting();
       s->set_compositing(v1::COMPOSITING_MAXIMUM);
     }},
    {"spec.clip.box.upper", "finite",
     [](v1::FrameSpec* s) { s->mutable_clip()->mutable_box()->mutable_upper()->set_x(kInfinity); }},
    {"spec.clip.box", "x runs from 0 to 0",
     [](v1::FrameSpec* s) { s->mutable_clip()->mutable_box(); }},
    {"spec.clip.box.space", "SPACE_WORLD",
     [](v1::FrameSpec* s) { s->mutable_clip()->mutable_box()->set_space(v1::Space(5)); }},
    {"spec.clip.planes", "7 planes, outside 0 to 6",
     [](v1::FrameSpec* s) {
       for (int i = 0; i < 7; ++i) {
         s->mutable_clip()->add_planes()->mutable_normal()->set_x(1);
       }
     }},
    {"spec.clip.planes", "normal", [](v1::FrameSpec* s) { s->mutable_clip()->add_planes(); }},
    {"spec.clip.planes[0].offset", "finite",
     [](v1::FrameSpec* s) { s->mutable_clip()->add_planes()->set_offset(kNan); }},
    {"spec.color_transfer_function", "without a color_field",
     [](v1::FrameSpec* s) { s->mutable_color_transfer_function()->add_points(); }},
    {"spec.color_transfer_function.points", "0 points",
     [](v1::FrameSpec* s) {
       s->set_color_field("heat");
       s->mutable_color_transfer_function();
     }},
    {"spec.background", "0 to 1", [](v1::FrameSpec* s) { s->mutable_background()->set_green(2); }},
};

TEST(SpecTest, EachRangeIsCheckedAndTheFieldNamed) {
  for (const BadSpec& bad : kBadSpecs) {
    v1::FrameSpec proto;
    bad.spoil(&proto);
    const auto result = FromProto(proto, "spec");
    EXPECT_THAT(result, FailsWith(absl::StatusCode::kInvalidArgument, bad.text)) << bad.field;
    EXPECT_EQ(FieldOf(result.status()), bad.field) << MessageOf(result.status());
  }
}

TEST(SpecTest, TheLargestRawFrameIsTaken) {
  v1::FrameSpec proto;
  proto.set_encoding(v1::RAW_RGBA_F32);
  proto.set_width_px(2048);
  proto.set_height_px(2048);
  EXPECT_OK(FromProto(proto, "spec").status());
}

frames::Frame SmallFrame() {
  frames::Frame frame;
  frame.dataset = "lab/plume";
  frame.step = 7;
  frame.time_ns = -5;
  frame.frame_number = 21;
  frame.used = FullSpec();
  frame.width_px = 2;
  frame.height_px = 3;
  frame.encoding = frames::Encoding::kRawRgba8;
  frame.pixels = std::string(24, 'x');
  frame.stats = {1, 2, 3, 4, 5, 6, 1.5, 2.5, 3.5, 4.5, 5.5};
  frame.index = 3;
  frame.warnings.push_back({"two chunks", 2});
  return frame;
}

TEST(FrameTest, ComesBackIdentical) {
  ASSERT_OK_AND_ASSIGN(const frames::Frame back, FromProto(ToProto(SmallFrame())));
  const frames::Frame sent = SmallFrame();
  EXPECT_EQ(back.dataset, sent.dataset);
  EXPECT_EQ(back.step, sent.step);
  EXPECT_EQ(back.time_ns, sent.time_ns);
  EXPECT_EQ(back.frame_number, sent.frame_number);
  EXPECT_EQ(back.used, sent.used);
  EXPECT_EQ(back.width_px, sent.width_px);
  EXPECT_EQ(back.height_px, sent.height_px);
  EXPECT_EQ(back.encoding, sent.encoding);
  EXPECT_EQ(back.pixels, sent.pixels);
  EXPECT_EQ(back.index, sent.index);
  EXPECT_EQ(back.stats.chunks_total, 3U);
  EXPECT_EQ(back.stats.samples, 6U);
  EXPECT_EQ(back.stats.read_ms, 1.5);
  EXPECT_EQ(back.stats.encode_ms, 5.5);
  ASSERT_EQ(back.warnings.size(), 1U);
  EXPECT_EQ(back.warnings[0].message, "two chunks");
  EXPECT_EQ(back.warnings[0].count, 2U);
}

TEST(FrameTest, PixelsMustFitTheSize) {
  v1::Frame proto = ToProto(SmallFrame());
  proto.mutable_pixels()->pop_back();
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "23 bytes"));
  proto = ToProto(SmallFrame());
  proto.set_width_px(0xFFFFFFFFU);
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "outside 1 to 16384"));
  proto = ToProto(SmallFrame());
  proto.set_encoding(v1::PNG);
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "said to be PNG"));
  proto = ToProto(SmallFrame());
  proto.set_encoding(v1::FOVEATED);
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "said to be FOVEATED"));
  proto.set_encoding(v1::Encoding(12));
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "does not understand"));
}

DatasetSummary SmallDataset() {
  DatasetSummary summary;
  summary.name = "lab/plume";
  summary.info.hierarchy = *Hierarchy::Make({10, 20, 30});
  summary.info.committed_steps = 3;
  summary.info.fields = {{"density", "float32", -1, 2.5}, {"heat", "float32", 0, 9}};
  summary.info.fields[1].lost_steps = {0, 2};
  summary.info.clock = "unix";
  summary.info.default_field = "heat";
  summary.info.index_to_world.m[3] = 12.5;
  summary.info.world_unit = "m";
  summary.first_time_ns = -3;
  summary.last_time_ns = 40;
  summary.default_spec = FullSpec();
  return summary;
}

TEST(DatasetTest, ComesBackIdentical) {
  ASSERT_OK_AND_ASSIGN(const DatasetSummary back, FromProto(ToProto(SmallDataset())));
  const DatasetSummary sent = SmallDataset();
  EXPECT_EQ(back.name, sent.name);
  EXPECT_EQ(back.info.hierarchy, sent.info.hierarchy);
  EXPECT_EQ(back.info.committed_steps, sent.info.committed_steps);
  EXPECT_EQ(back.info.fields, sent.info.fields);
  EXPECT_EQ(back.info.default_field, sent.info.default_field);
  EXPECT_EQ(back.info.wavelet, "haar");
  EXPECT_EQ(back.info.index_to_world, sent.info.index_to_world);
  EXPECT_EQ(back.info.world_unit, sent.info.world_unit);
  EXPECT_EQ(back.info.clock, "unix");
  EXPECT_EQ(back.first_time_ns, -3);
  EXPECT_EQ(back.last_time_ns, 40);
  EXPECT_EQ(back.default_spec, sent.default_spec);
}

TEST(DatasetTest, NonsenseIsRefused) {
  v1::Dataset proto = ToProto(SmallDataset());
  proto.set_ny(0);
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "10 x 0 x 30"));
  proto = ToProto(SmallDataset());
  proto.mutable_index_to_world()->RemoveLast();
  EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "16 finite numbers"));
  for (const uint64_t step : {1, 3}) {  // out of order; not committed
    proto = ToProto(SmallDataset());
    proto.mutable_fields(1)->add_lost_steps(step);
    EXPECT_THAT(FromProto(proto), FailsWith(absl::StatusCode::kInternal, "of 'heat' is out of"));
  }
}

frames::FramePlan SmallPlan() {
  frames::FramePlan plan;
  plan.used = FullSpec();
  plan.coefficients = 1000;
  plan.chunks_read = 7;
  plan.chunks_total = 9;
  plan.bytes_read = 12345;
  plan.counts.super_voxels = 990;
  plan.counts.samples = 5000;
  plan.counts.memory_bytes = int64_t{1} << 40;
  plan.threads = 3;
  plan.time = {1, 2.5, 3, 4};
  plan.warnings = {{"coarser there", 0, frames::Warning::Code::kNotRetained}};
  return plan;
}

TEST(PlanTest, ComesBackIdentical) {
  const frames::FramePlan sent = SmallPlan();
  ASSERT_OK_AND_ASSIGN(const frames::FramePlan back, FromProto(ToProto("plume", 2, sent)));
  EXPECT_EQ(back.used, sent.used);
  EXPECT_EQ(back.coefficients, 1000U);
  EXPECT_EQ(back.chunks_read, 7U);
  EXPECT_EQ(back.chunks_total, 9U);
  EXPECT_EQ(back.bytes_read, 12345U);
  EXPECT_EQ(back.counts.super_voxels, 990);
  EXPECT_EQ(back.counts.samples, 5000);
  EXPECT_EQ(back.counts.memory_bytes, int64_t{1} << 40);
  EXPECT_EQ(back.threads, 3);
  EXPECT_EQ(back.time.reconstruct_ms, 2.5);
  EXPECT_EQ(back.time.Total(), 10.5);
  ASSERT_EQ(back.warnings.size(), 1U);
  EXPECT_EQ(back.warnings[0].message, "coarser there");
  EXPECT_EQ(back.warnings[0].code, frames::Warning::Code::kNotRetained);
}

TEST(PlanTest, NonsenseIsRefused) {
  const v1::FramePlan good = ToProto("plume", 2, SmallPlan());
  const auto refuses = [&](const std::function<void(v1::FramePlan*)>& spoil) {
    v1::FramePlan proto = good;
    spoil(&proto);
    EXPECT_EQ(FromProto(proto).status().code(), absl::StatusCode::kInternal);
  };
  refuses([](auto* proto) { proto->set_samples(~uint64_t{0}); });
  refuses([](auto* proto) { proto->set_read_ms(-1); });
  refuses([](auto* proto) { proto->set_render_ms(std::numeric_limits<double>::infinity()); });
  refuses([](auto* proto) { proto->set_threads(0); });
  refuses([](auto* proto) { proto->mutable_used()->set_rate(-1); });
}

TEST(StatusTest, DetailsTravel) {
  const Status sent = BadField("spec.rate", "0 is outside 1 to 65536");
  const Status back = FromGrpc(ToGrpc(sent));
  EXPECT_EQ(back.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(MessageOf(back), "spec.rate: 0 is outside 1 to 65536");
  EXPECT_EQ(FieldOf(back), "spec.rate");
  EXPECT_OK(FromGrpc(ToGrpc(absl::OkStatus())));
  EXPECT_EQ(FieldOf(FromGrpc(ToGrpc(NotFound("no")))), "");
}

TEST(StatusTest, TrailersStaySmallWhateverIsEchoed) {
  const std::string huge(1 << 20, '\n');
  const grpc::Status status = ToGrpc(BadField("spec.field", huge));
  // Percent-encoding triples the one, base64 adds a third to the other.
  EXPECT_LT(3 * status.error_message().size() + status.error_details().size() * 4 / 3, 8000U);
}

TEST(StatusTest, PrintableKeepsCharactersWhole) {
  EXPECT_EQ(Printable("a\nb\x7f"), "a\\x0ab\\x7f");
  EXPECT_EQ(Printable("\xC3\xA9\xC3\xA9", 1), "\xC3\xA9...");
  EXPECT_EQ(Printable("abc", 3), "abc");
}

}  // namespace
}  // namespace fovea::wire
