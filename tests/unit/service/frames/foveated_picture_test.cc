// A FOVEATED frame is the picture: what it expands to is what the server would have sent, for
// whatever a spec may ask for.
#include "service/frames/foveated_picture.h"

#include <cmath>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "service/frames/foveated_codec.h"
#include "service/frames/frames.h"
#include "tests/support/fake_dataset.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::FakeDataset;

struct Case {
  const char* name;
  std::function<void(FrameSpec*)> change;
};

void SetPerspective(FrameSpec* spec, const Vec3& eye) {
  spec->view = {};
  spec->view.perspective = PerspectiveSpec{{eye}, Position{{20, 16, 24}}, {}, 60.0};
}

const Case kCases[] = {
    {"as it comes", [](FrameSpec*) {}},
    {"no smoothing", [](FrameSpec* s) { s->smoothing = render::Smoothing::kNone; }},
    {"image smoothing", [](FrameSpec* s) { s->smoothing = render::Smoothing::kImage; }},
    {"splines", [](FrameSpec* s) { s->basis = render::Basis::kBspline; }},
    {"from above", [](FrameSpec* s) { s->view.elevation_deg = 90; }},
    {"oblique, axis x",
     [](FrameSpec* s) { s->view.azimuth_deg = 193, s->view.elevation_deg = 17; }},
    {"oblique, axis z",
     [](FrameSpec* s) { s->view.azimuth_deg = -60, s->view.elevation_deg = -71; }},
    {"zoomed in", [](FrameSpec* s) { s->view.span_voxels = 9; }},
    {"one pixel", [](FrameSpec* s) { s->width_px = s->height_px = 1; }},
    {"odd size", [](FrameSpec* s) { s->width_px = 131, s->height_px = 37; }},
    {"rate 1", [](FrameSpec* s) { s->rate = 1; }},
    {"everything kept", [](FrameSpec* s) { s->rate = 48; }},
    {"a rate each axis", [](FrameSpec* s) { s->rate = Rate(3, 40, 7); }},
    {"fovea on a corner",
     [](FrameSpec* s) {
       s->fovea = Position{{0, 32, 48}};
     }},
    {"ball window", [](FrameSpec* s) { s->window = WindowShape::kSphere; }},
    {"fused", [](FrameSpec* s) { s->mode = Mode::kFused; }},
    {"maximum", [](FrameSpec* s) { s->compositing = render::Compositing::kMaximum; }},
    {"lit",
     [](FrameSpec* s) {
       s->lighting = render::Lighting{true, 1, 1, 1, 2, {1, 2, 3}};
     }},
    {"marked, on white",
     [](FrameSpec* s) {
       s->fovea_marker = true, s->background = render::Color{1, 1, 1};
     }},
    {"marker outside", [](FrameSpec* s) { s->fovea_marker = true, s->view.span_voxels = 1e-3; }},
    {"two fields", [](FrameSpec* s) { s->color_field = "warm"; }},
    {"nothing to see",
     [](FrameSpec* s) {
       s->clip.planes.push_back({{1, 0, 0}, 1e6});
     }},
    {"beside the volume",
     [](FrameSpec* s) {
       s->view.center = Position{{1000, 1000, 1000}};
     }},
    {"perspective",
     [](FrameSpec* s) {
       SetPerspective(s, {-40, -30, 60});
     }},
    {"perspective, unsmoothed",
     [](FrameSpec* s) {
       SetPerspective(s, {-40, -30, 60}), s->smoothing = render::Smoothing::kNone;
     }},
    {"perspective, splines",
     [](FrameSpec* s) {
       SetPerspective(s, {90, 20, 20}), s->basis = render::Basis::kBspline;
     }},
    {"perspective, inside",
     [](FrameSpec* s) {
       SetPerspective(s, {18, 15, 12}), s->fovea_marker = true;
     }},
    {"perspective, looking away",
     [](FrameSpec* s) {
       SetPerspective(s, {-40, 16, 24});
       s->view.perspective->target = Position{{-80, 16, 24}};
     }},
};

class FoveatedPictureTest : public ::testing::Test {
 protected:
  StatusOr<FrameSpec> Resolved(const Case& of) {
    FrameSpec spec;
    spec.width_px = 64;
    spec.height_px = 48;
    spec.rate = 6;
    of.change(&spec);
    return ResolveSpec(dataset_, spec, defaults_);
  }
  StatusOr<Frame> Render(FrameSpec spec, Encoding encoding) {
    spec.encoding = encoding;
    return RenderFrame(dataset_, "fake", 1, spec, 1);
  }

  FakeDataset dataset_{2};
  const FrameSpec defaults_ = *DefaultSpec(dataset_);
};

TEST_F(FoveatedPictureTest, ExpandsToTheBytesThatTheServerWouldHaveSent) {
  for (const Case& c : kCases) {
    SCOPED_TRACE(c.name);
    ASSERT_OK_AND_ASSIGN(const FrameSpec spec, Resolved(c));
    ASSERT_OK_AND_ASSIGN(const Frame foveated, Render(spec, Encoding::kFoveated));
    for (const Encoding encoding : {Encoding::kRawRgba8, Encoding::kPng, Encoding::kJpeg}) {
      ASSERT_OK_AND_ASSIGN(const Frame expected, Render(spec, encoding));
      for (const int threads : {1, 3}) {
        ASSERT_OK_AND_ASSIGN(const Frame expanded, ExpandFrame(foveated, encoding, threads));
        EXPECT_TRUE(expanded.pixels == expected.pixels) << static_cast<int>(encoding);
        EXPECT_EQ(expanded.used, expected.used);
        EXPECT_EQ(expanded.encoding, encoding);
      }
    }
  }
}

TEST_F(FoveatedPictureTest, CasesShowSomethingWhereTheyShould) {
  for (const Case& c : kCases) {
    ASSERT_OK_AND_ASSIGN(const FrameSpec spec, Resolved(c));
    ASSERT_OK_AND_ASSIGN(const Frame frame, Render(spec, Encoding::kRawRgba8));
    const std::string name = c.name;
    const bool empty = name == "nothing to see" || name == "beside the volume" ||
                       name == "perspective, looking away";
    const bool all_zero = frame.pixels.find_first_not_of('\0') == std::string::npos;
    EXPECT_EQ(all_zero, empty) << name;
  }
}

TEST_F(FoveatedPictureTest, FloatsAreAsCloseAsTheFormatSays) {
  double largest = 0;
  for (const Case& c : kCases) {
    ASSERT_OK_AND_ASSIGN(const FrameSpec spec, Resolved(c));
    ASSERT_OK_AND_ASSIGN(const Frame foveated, Render(spec, Encoding::kFoveated));
    ASSERT_OK_AND_ASSIGN(const Frame exact, Render(spec, Encoding::kRawRgbaF32));
    ASSERT_OK_AND_ASSIGN(const Frame expanded, ExpandFrame(foveated, Encoding::kRawRgbaF32));
    ASSERT_EQ(expanded.pixels.size(), exact.pixels.size());
    for (size_t i = 0; i < exact.pixels.size(); i += sizeof(float)) {
      float a = 0;
      float b = 0;
      std::memcpy(&a, &exact.pixels[i], sizeof(a));
      std::memcpy(&b, &expanded.pixels[i], sizeof(b));
      largest = std::max<double>(largest, std::abs(a - b));
    }
  }
  EXPECT_LT(largest, 1.5 / (1 << render::kLeafBits));
  EXPECT_GT(largest, 0.1 / (1 << render::kLeafBits));  // or nothing was rounded
}

TEST_F(FoveatedPictureTest, IsEncodedAgainToTheSameBytes) {
  for (const Case& c : kCases) {
    SCOPED_TRACE(c.name);
    ASSERT_OK_AND_ASSIGN(const FrameSpec spec, Resolved(c));
    ASSERT_OK_AND_ASSIGN(const Frame frame, Render(spec, Encoding::kFoveated));
    ASSERT_OK_AND_ASSIGN(const FoveatedPicture picture, DecodeFoveated(frame.pixels));
    ASSERT_OK_AND_ASSIGN(const std::string again, EncodeFoveated(picture));
    EXPECT_TRUE(again == frame.pixels);
  }
}

TEST_F(FoveatedPictureTest, IsNoLargerThanWhatIsKeptFree) {
  for (const Case& c : kCases) {
    ASSERT_OK_AND_ASSIGN(const FrameSpec spec, Resolved(c));
    ASSERT_OK_AND_ASSIGN(const Frame frame, Render(spec, Encoding::kFoveated));
    const store::DatasetInfo info = dataset_.info();
    const auto retained = RetainedSet::Make(info.hierarchy, FoveaOf(spec));
    EXPECT_LE(static_cast<int64_t>(frame.pixels.size()), MostFoveatedBytes(info, *retained, spec))
        << c.name;
  }
}

TEST_F(FoveatedPictureTest, ExpandsOnlyWhatFits) {
  ASSERT_OK_AND_ASSIGN(const FrameSpec spec, Resolved(kCases[0]));
  ASSERT_OK_AND_ASSIGN(Frame frame, Render(spec, Encoding::kFoveated));
  EXPECT_THAT(ExpandFrame(frame, Encoding::kFoveated),
              FailsWith(absl::StatusCode::kInvalidArgument, "to FOVEATED"));
  frame.width_px = 65;
  EXPECT_THAT(ExpandFrame(frame, Encoding::kPng),
              FailsWith(absl::StatusCode::kDataLoss, "65 x 48 pixels holds a picture of 64 x 48"));
  ASSERT_OK_AND_ASSIGN(const Frame png, Render(spec, Encoding::kPng));
  EXPECT_THAT(ExpandFrame(png, Encoding::kRawRgba8),
              FailsWith(absl::StatusCode::kInvalidArgument, "of PNG"));
}

}  // namespace
}  // namespace fovea::frames
