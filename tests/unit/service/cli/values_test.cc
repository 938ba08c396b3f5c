#include "service/cli/values.h"

#include <cmath>
#include <fstream>

#include "service/cli/console.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::cli {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::TemporaryFolder;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

template <typename Parser>
void ExpectBad(Parser parser, const std::vector<std::string>& texts) {
  for (const std::string& text : texts) {
    EXPECT_THAT(parser(text), FailsWith(kInvalid, "'" + text + "'"));
  }
}

TEST(Values, Positions) {
  EXPECT_EQ(*ParsePosition("1,2.5,-3"), (frames::Position{{1, 2.5, -3}, false}));
  EXPECT_EQ(*ParsePosition("1e2, 0 ,.5w"), (frames::Position{{100, 0, 0.5}, true}));
  EXPECT_TRUE(std::isnan(ParsePosition("nan,0,0")->at.x));  // ranges are checked later
  ExpectBad(ParsePosition, {"", "1,2", "1,2,3,4", "1,2,x", "1,,3", "w", "1;2;3", "1,2,3ww"});
  EXPECT_EQ(FormatPosition({{0.1, 2, -3}, true}), "0.1,2,-3w");
}

TEST(Values, ViewsSizesBoxes) {
  EXPECT_EQ(*ParseView("-30,20"), std::pair(-30.0, 20.0));
  ExpectBad(ParseView, {"30", "1,2,3", "a,b"});
  EXPECT_EQ(*ParseSize("640x480"), (std::pair<int64_t, int64_t>(640, 480)));
  EXPECT_EQ(*ParseSize("100000x100000"), (std::pair<int64_t, int64_t>(100000, 100000)));
  ExpectBad(ParseSize, {"640", "640x", "x480", "64.0x48", "640x480x3", "99999999999999999999x1"});
  EXPECT_EQ(*ParseBox("0,1,2,3,4,5"), (Box3{{0, 1, 2}, {3, 4, 5}}));
  ExpectBad(ParseBox, {"0,0,0,1,1", "0,0,0,0,1,1", "5,0,0,1,1,1", "0,0,0,1,1,1.5"});
}

TEST(Values, Steps) {
  EXPECT_EQ(*ParseSteps("7"), (StepRange{7, 7, 1}));
  EXPECT_EQ(*ParseSteps("0-120x2"), (StepRange{0, 120, 2}));
  EXPECT_EQ(*ParseSteps("3-"), (StepRange{3, std::nullopt, 1}));
  EXPECT_EQ(*ParseSteps("3-x4"), (StepRange{3, std::nullopt, 4}));
  ExpectBad(ParseSteps,
            {"", "-", "-3", "5-3", "1-2x0", "1-2x", "1-2x-1", "a", "1-b", "1.5", "1-2-3"});
}

TEST(Values, ShardsWeightingsSmoothingsColours) {
  EXPECT_EQ(*ParseShard("0/1"), (Shard{0, 1}));
  EXPECT_EQ(*ParseShard("3/4"), (Shard{3, 4}));
  ExpectBad(ParseShard, {"4/4", "-1/4", "1", "1/0", "a/b"});
  EXPECT_EQ(ParseWeighting("chop")->kind, render::Weighting::Kind::kChop);
  EXPECT_EQ(ParseWeighting("falloff:0.25")->falloff_per_voxel, 0.25);
  ExpectBad(ParseWeighting, {"", "falloff", "falloff:", "falloff:x", "None"});
  for (const char* text : {"none", "chop", "falloff:0.1"}) {
    EXPECT_EQ(FormatWeighting(*ParseWeighting(text)), text);
  }
  for (const char* text : {"none", "image", "full"}) {
    EXPECT_STREQ(SmoothingName(*ParseSmoothing(text)), text);
  }
  ExpectBad(ParseSmoothing, {"", "FULL", "half"});
  for (const char* text : {"exact", "fast"}) {
    EXPECT_STREQ(ReconstructionName(*ParseReconstruction(text)), text);
  }
  ExpectBad(ParseReconstruction, {"", "quick"});
  for (const char* text : {"bilinear", "bspline"}) {
    EXPECT_STREQ(BasisName(*ParseBasis(text)), text);
  }
  ExpectBad(ParseBasis, {"", "linear", "B-spline"});
  EXPECT_EQ(*ParseColor("0,0.5,1"), (render::Color{0, 0.5F, 1}));
  ExpectBad(ParseColor, {"red", "1,1", "1,1,1,1"});
}

TEST(Values, TransferFunctionsFromTextAndFile) {
  ASSERT_OK_AND_ASSIGN(const auto transfer, ParseTransfer("0:0,0,0:0;1:1,0.5,0:0.25"));
  ASSERT_EQ(transfer.points.size(), 2U);
  EXPECT_EQ(transfer.points[1].color.green, 0.5F);
  const TemporaryFolder folder;
  const std::string path = folder / "tf.json";
  std::ofstream(path) << R"([{"value":0,"color":[0,0,0],"opacity":0},
                            {"value":1,"color":[1,0.5,0],"opacity":0.25}])";
  EXPECT_EQ(*ParseTransfer(path), transfer);
  std::ofstream(path) << "nonsense";
  EXPECT_THAT(ParseTransfer(path), FailsWith(absl::StatusCode::kFailedPrecondition, path));
  std::ofstream(path) << std::string(2 << 20, ' ');
  EXPECT_THAT(ParseTransfer(path),
              FailsWith(absl::StatusCode::kFailedPrecondition, "longer than 1 MiB"));
  EXPECT_THAT(ParseTransfer(folder / "no.json"),
              FailsWith(absl::StatusCode::kNotFound, "cannot be opened"));
}

TEST(Values, TimesFromTextAndFile) {
  EXPECT_EQ(*ParseTimes("0,0.5 2"), (std::vector<double>{0, 0.5, 2}));
  ExpectBad(ParseTimes, {"2e", "e", "1e999", ",", ""});
  EXPECT_THAT(ParseTimes("1,2e,3"), FailsWith(kInvalid, "'2e'"));
  EXPECT_THAT(ParseTimes("no_such_file"), FailsWith(absl::StatusCode::kNotFound, "no_such_file"));
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/times.txt";
  std::ofstream(path) << "0\n0.25\r\n1;\n";
  EXPECT_EQ(*ParseTimes(path), (std::vector<double>{0, 0.25, 1}));
  std::ofstream(path) << "1\n\x1b[2J" << std::string(1000, 'x');
  const auto odd = ParseTimes(path);  // what is shown of it does not take the terminal over
  EXPECT_THAT(odd, FailsWith(kInvalid, "'?[2Jxxx"));
  EXPECT_LT(odd.status().message().size(), 100U);
  EXPECT_THAT(ParseTimes("/dev/zero"), FailsWith(kInvalid, "too long"));  // it has no end
}

TEST(Values, ShellQuoting) {
  EXPECT_EQ(ShellQuote("density"), "density");
  EXPECT_EQ(ShellQuote("a b;c"), "'a b;c'");
  EXPECT_EQ(ShellQuote("it's"), "'it'\\''s'");
  EXPECT_EQ(ShellQuote(""), "''");
}

frames::FrameSpec Resolved() {
  frames::FrameSpec spec;
  spec.field = "density";
  spec.view = {30, -20.5, frames::Position{{20, 16, 24}}, 70.25, {}};
  spec.fovea = frames::Position{{19, 0.1, 24}};
  spec.rate = 40;
  spec.transfer = *ParseTransfer("0:0,0,0:0;1:1,0.5,0:0.1");
  spec.weighting = render::Weighting{};
  spec.smoothing = render::Smoothing::kFull;
  spec.width_px = 640;
  spec.height_px = 480;
  spec.jpeg_quality = 90;
  spec.background = render::Color{};
  return spec;
}

TEST(ParseRate, OneNumberOrOneAnAxis) {
  EXPECT_EQ(*ParseRate("40"), Rate(40));
  EXPECT_EQ(*ParseRate("40,40,40"), Rate(40));
  EXPECT_EQ(*ParseRate(" 40, 12.5,8 "), Rate(40, 12.5, 8));
  EXPECT_THAT(ParseRate("40,12"), FailsWith(kInvalid, "'40,12'"));
  EXPECT_THAT(ParseRate(""), FailsWith(kInvalid, "RX,RY,RZ"));
}

TEST(ParseWindow, KnowsThreeShapes) {
  EXPECT_EQ(*ParseWindow("sphere"), WindowShape::kSphere);
  EXPECT_EQ(*ParseWindow("smooth"), WindowShape::kSmooth);
  EXPECT_EQ(*ParseWindow("cube"), WindowShape::kCube);
  EXPECT_THAT(ParseWindow("ball"), FailsWith(kInvalid, "'ball' is not cube, sphere or smooth"));
}

TEST(PinningFlags, OfAPerspectiveView) {
  frames::FrameSpec spec = Resolved();
  spec.view = {};
  spec.view.perspective =
      frames::PerspectiveSpec{{{-10, 5.5, 6}}, frames::Position{{20, 16, 24}}, Vec3{0, 0, 1}, 45};
  const std::string flags = PinningFlags(spec, {40, 32, 48});
  EXPECT_NE(flags.find("--rate 40 --eye -10,5.5,6 --target 20,16,24 --fov 45 --size"),
            std::string::npos)
      << flags;
  spec.view.perspective->up = Vec3{0, 1, 0};
  const std::string tilted = PinningFlags(spec, {40, 32, 48});
  EXPECT_NE(tilted.find("--fov 45 --up 0,1,0 --size"), std::string::npos) << tilted;
}

TEST(PinningFlags, SayEverythingAndLeaveOutWhatAllChooseAlike) {
  frames::FrameSpec spec = Resolved();
  EXPECT_EQ(PinningFlags(spec, {40, 32, 48}),
            "--field density --fovea 19,0.1,24 --rate 40 --view 30,-20.5 --span 70.25 "
            "--size 640x480 --transfer '0:0,0,0:0;1:1,0.5,0:0.1' --weighting none "
            "--smoothing full");
  spec.background->red = 0.5F;
  spec.fovea_marker = true;
  spec.strict = true;
  spec.rate = {40, 20, 10.5};
  spec.window = WindowShape::kSphere;
  spec.reconstruction = Reconstruction::kFast;
  const std::string flags = PinningFlags(spec, {40, 32, 50});
  EXPECT_NE(flags.find("--rate 40,20,10.5 "), std::string::npos) << flags;
  EXPECT_NE(flags.find("--window sphere --reconstruction fast --center 20,16,24 --background "
                       "0.5,0,0 --fovea-marker --strict"),
            std::string::npos)
      << flags;
}

TEST(PinningFlags, SayWhatShadesCutsAndColours) {
  frames::FrameSpec spec = Resolved();
  spec.compositing = render::Compositing::kEmissionAbsorption;
  spec.mode = frames::Mode::kTwoPhase;
  EXPECT_EQ(OptionFlags(spec), "");
  spec.compositing = render::Compositing::kMaximum;
  spec.mode = frames::Mode::kFused;
  spec.lighting = *ParseLighting("0.1,0.5,0.25,4");
  spec.lighting->to_light = {0, -1, 0.5};
  spec.clip.box = *ParseClipBox("1,2,3,4,5.5,6");
  spec.clip.planes = {*ParseClipPlane("1,0,-1,2.5"), *ParseClipPlane("0,1,0,-3w")};
  spec.color_field = "heat";
  spec.color_transfer = *ParseTransfer("0:0,0,0:0;1:1,0.5,0:0.1");
  EXPECT_EQ(OptionFlags(spec),
            " --compositing maximum --lighting 0.1,0.5,0.25,4 --light 0,-1,0.5 "
            "--clip-box 1,2,3,4,5.5,6 --clip-plane 1,0,-1,2.5 --clip-plane 0,1,0,-3w "
            "--color-field heat --color-transfer '0:0,0,0:0;1:1,0.5,0:0.1' --mode fused");
  EXPECT_NE(PinningFlags(spec, {40, 32, 48}).find(OptionFlags(spec)), std::string::npos);
}

TEST(WithFlag, NamesTheFlagOfTheFieldThatTheMessageStartsWith) {
  EXPECT_EQ(WithFlag(InvalidArgument("rate 0 is bad")), "--rate: rate 0 is bad");
  EXPECT_EQ(WithFlag(InvalidArgument("width_px 7")), "--size: width_px 7");
  EXPECT_EQ(WithFlag(InvalidArgument("server a:1: header.voxel: is missing")),
            "--bounds and --voxel: server a:1: header.voxel: is missing");
  EXPECT_EQ(WithFlag(OutOfRange("step 9 is not there")), "--step: step 9 is not there");
  EXPECT_EQ(WithFlag(NotFound("server a:1: field 'q' is not there")),
            "--field: server a:1: field 'q' is not there");
  EXPECT_EQ(WithFlag(InvalidArgument("rated highly")), "rated highly");
  EXPECT_EQ(WithFlag(InvalidArgument("")), "");
  EXPECT_EQ(WithFlag(ResourceExhausted("field 'q' cannot be written")),
            "field 'q' cannot be written");
}

TEST(Human, BytesAndSeconds) {
  EXPECT_EQ(HumanBytes(1023), "1023 B");
  EXPECT_EQ(HumanBytes(1536), "1.5 KiB");
  EXPECT_EQ(HumanBytes(uint64_t{3} << 40), "3.0 TiB");
  EXPECT_EQ(HumanSeconds(1.26), "1.3 s");
  EXPECT_EQ(HumanSeconds(75), "1 min 15 s");
  EXPECT_EQ(HumanSeconds(7300), "2 h 1 min");
}

}  // namespace
}  // namespace fovea::cli
