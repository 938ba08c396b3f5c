#include "service/frames/frames.h"

#include <cstring>

#include "tests/support/decode.h"
#include "tests/support/fake_dataset.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::FakeDataset;

FrameSpec Small(FakeDataset& dataset) {
  FrameSpec spec;
  spec.width_px = 64;
  spec.height_px = 48;
  return *ResolveSpec(dataset, spec, *DefaultSpec(dataset));
}

TEST(RenderFrame, ShowsTheBallWhereItIs) {
  FakeDataset dataset(4);
  FrameSpec spec = Small(dataset);
  spec.encoding = Encoding::kRawRgbaF32;
  ASSERT_OK_AND_ASSIGN(const Frame frame, RenderFrame(dataset, "fake", 3, spec, 1));
  std::vector<float> rgba(size_t{64} * 48 * 4);
  ASSERT_EQ(frame.pixels.size(), rgba.size() * sizeof(float));
  std::memcpy(rgba.data(), frame.pixels.data(), frame.pixels.size());
  double sum = 0;
  double row = 0;
  double column = 0;
  for (int j = 0; j < 48; ++j) {
    for (int i = 0; i < 64; ++i) {
      const double alpha = rgba[4 * static_cast<size_t>(j * 64 + i) + 3];
      sum += alpha;
      row += alpha * (j + 0.5);
      column += alpha * (i + 0.5);
    }
  }
  ASSERT_GT(sum, 5);
  // Step 3: the ball is at 20, 16, 24, the middle of the volume and so of the picture.
  EXPECT_NEAR(row / sum, 24, 1);
  EXPECT_NEAR(column / sum, 32, 1);
}

TEST(RenderFrame, TellsWhatItShowsAndWhatItCost) {
  FakeDataset dataset(2);
  const FrameSpec spec = Small(dataset);
  ASSERT_OK_AND_ASSIGN(const Frame frame, RenderFrame(dataset, "lab/fake", 1, spec, 1));
  EXPECT_EQ(frame.dataset, "lab/fake");
  EXPECT_EQ(frame.step, 1);
  EXPECT_EQ(frame.time_ns, 2'500'000'000);
  EXPECT_EQ(frame.frame_number, 102);
  EXPECT_EQ(frame.used, spec);
  EXPECT_EQ(frame.width_px, 64);
  EXPECT_EQ(frame.height_px, 48);
  EXPECT_EQ(frame.stats.chunks_read, 7U);
  EXPECT_EQ(frame.stats.chunks_total, 30U);
  EXPECT_EQ(frame.stats.bytes_read, 1234U);
  EXPECT_GT(frame.stats.coefficients, 100U);
  EXPECT_GT(frame.stats.super_voxels, 100U);
  EXPECT_GT(frame.stats.samples, 100U);
  EXPECT_TRUE(frame.warnings.empty());
  EXPECT_EQ(fovea::testing::DecodePng(frame.pixels).width, 64);
}

TEST(RenderFrame, RefusesWhatMemoryCannotHold) {
  FakeDataset dataset(1);
  FrameSpec spec = Small(dataset);
  dataset.set_claimed_dims({40000, 40000, 40000});
  spec.rate = 40000;
  EXPECT_THAT(RenderFrame(dataset, "fake", 0, spec, 1),
              FailsWith(absl::StatusCode::kResourceExhausted, "rate 40000 "));
  spec.window = WindowShape::kSphere;  // whose coefficients it would take hours to count
  EXPECT_THAT(RenderFrame(dataset, "fake", 0, spec, 1),
              FailsWith(absl::StatusCode::kResourceExhausted, "rate 40000 "));
}

TEST(RenderFrame, DoesNotDependOnThreadsAndRepeats) {
  FakeDataset dataset(1);
  const FrameSpec spec = Small(dataset);
  ASSERT_OK_AND_ASSIGN(const Frame one, RenderFrame(dataset, "fake", 0, spec, 1));
  ASSERT_OK_AND_ASSIGN(const Frame four, RenderFrame(dataset, "fake", 0, one.used, 4));
  EXPECT_EQ(one.pixels, four.pixels);
}

TEST(RenderFrame, TheMarkerIsOnlyInBytePictures) {
  FakeDataset dataset(1);
  FrameSpec spec = Small(dataset);
  const auto render = [&](Encoding encoding, bool marker) {
    spec.encoding = encoding;
    spec.fovea_marker = marker;
    return RenderFrame(dataset, "fake", 0, spec, 1)->pixels;
  };
  EXPECT_EQ(render(Encoding::kRawRgbaF32, true), render(Encoding::kRawRgbaF32, false));
  EXPECT_NE(render(Encoding::kRawRgba8, true), render(Encoding::kRawRgba8, false));
}

TEST(RenderFrame, DamageIsAWarningOrAnErrorIfStrict) {
  FakeDataset dataset(1);
  FrameSpec spec = Small(dataset);
  dataset.set_damaged_chunks(3);
  ASSERT_OK_AND_ASSIGN(const Frame frame, RenderFrame(dataset, "fake", 0, spec, 1));
  ASSERT_EQ(frame.warnings.size(), 1U);
  EXPECT_EQ(frame.warnings[0].count, 3U);
  spec.strict = true;
  EXPECT_THAT(RenderFrame(dataset, "fake", 0, spec, 1),
              FailsWith(absl::StatusCode::kDataLoss, "chunk"));
}

std::vector<float> Floats(const Frame& frame) {
  std::vector<float> rgba(frame.pixels.size() / sizeof(float));
  std::memcpy(rgba.data(), frame.pixels.data(), frame.pixels.size());
  return rgba;
}

TEST(RenderFrame, ASecondFieldColoursWhatTheFirstShows) {
  FakeDataset dataset(2);
  FrameSpec spec = Small(dataset);
  spec.encoding = Encoding::kRawRgbaF32;
  ASSERT_OK_AND_ASSIGN(const Frame plain, RenderFrame(dataset, "fake", 1, spec, 1));
  spec.color_field = "warm";
  // Green where it is cold, whatever opacity is said; its ball is red.
  spec.color_transfer = render::TransferFunction{{{20, {0, 1, 0}, 0.0F}, {20, {1, 0, 0}, 1.0F}}};
  ASSERT_OK_AND_ASSIGN(const Frame frame, RenderFrame(dataset, "fake", 1, spec, 1));
  const std::vector<float> before = Floats(plain);
  const std::vector<float> after = Floats(frame);
  double red = 0;
  double green = 0;
  for (size_t i = 0; i < after.size(); i += 4) {
    ASSERT_EQ(after[i + 3], before[i + 3]) << i;
    ASSERT_NEAR(after[i] + after[i + 1], after[i + 3], 1e-5) << i;
    ASSERT_EQ(after[i + 2], 0) << i;
    red += after[i];
    green += after[i + 1];
  }
  EXPECT_GT(red, 1);
  EXPECT_GT(green, 1);
  EXPECT_EQ(frame.stats.chunks_read, 2 * plain.stats.chunks_read);
  EXPECT_EQ(frame.stats.chunks_total, 2 * plain.stats.chunks_total);
  EXPECT_EQ(frame.stats.bytes_read, 2 * plain.stats.bytes_read);
  EXPECT_EQ(frame.stats.coefficients, 2 * plain.stats.coefficients);
  EXPECT_EQ(frame.stats.super_voxels, 2 * plain.stats.super_voxels);
  dataset.set_damaged_chunks(1);
  ASSERT_OK_AND_ASSIGN(const Frame damaged, RenderFrame(dataset, "fake", 1, spec, 1));
  ASSERT_EQ(damaged.warnings.size(), 2U);
  EXPECT_THAT(damaged.warnings[1].message, ::testing::HasSubstr("'warm'"));
}

TEST(RenderFrame, FusedIsTheSamePicture) {
  FakeDataset dataset(2);
  for (const bool colored : {false, true}) {
    FrameSpec spec = Small(dataset);
    spec.encoding = Encoding::kRawRgbaF32;
    spec.rate = 7;
    spec.view.azimuth_deg = 30;
    if (colored) {
      spec.color_field = "warm";
      spec.color_transfer = spec.transfer;
    }
    ASSERT_OK_AND_ASSIGN(const Frame two_phase, RenderFrame(dataset, "fake", 1, spec, 1));
    spec.mode = Mode::kFused;
    ASSERT_OK_AND_ASSIGN(const Frame fused, RenderFrame(dataset, "fake", 1, spec, 2));
    EXPECT_EQ(fused.stats.samples, two_phase.stats.samples);
    EXPECT_EQ(fused.stats.coefficients, two_phase.stats.coefficients);
    const std::vector<float> expected = Floats(two_phase);
    const std::vector<float> pixels = Floats(fused);
    double sum = 0;
    for (size_t i = 0; i < pixels.size(); ++i) {
      ASSERT_NEAR(pixels[i], expected[i], 1.0 / 2048) << i;
      sum += pixels[i];
    }
    EXPECT_GT(sum, 5);
  }
}

TEST(RenderFrame, LightMaximumAndClipReachTheEngine) {
  FakeDataset dataset(1);
  FrameSpec spec = Small(dataset);
  spec.encoding = Encoding::kRawRgbaF32;
  const auto render = [&](const FrameSpec& asked) {
    return Floats(*RenderFrame(dataset, "fake", 0, asked, 1));
  };
  const std::vector<float> plain = render(spec);
  FrameSpec lit = spec;
  lit.lighting = render::Lighting{true, 0, 1, 0, 16, {0, 0, 1}};
  EXPECT_NE(render(lit), plain);
  FrameSpec maximum = spec;
  maximum.compositing = render::Compositing::kMaximum;
  EXPECT_NE(render(maximum), plain);
  FrameSpec clipped = spec;
  clipped.clip.box = ClipBox{{30, 0, 0}, {40, 32, 48}};  // nothing of the ball
  for (const float value : render(clipped)) {
    ASSERT_EQ(value, 0);
  }
  clipped.clip = {std::nullopt, {{{-1, 0, 0}, -30}}};  // all of it
  const std::vector<float> whole = render(clipped);
  for (size_t i = 0; i < plain.size(); ++i) {
    ASSERT_NEAR(whole[i], plain[i], 1e-5) << i;
  }
}

TEST(RenderFrame, RefusesAStepThatIsNotThere) {
  FakeDataset dataset(2);
  const FrameSpec spec = Small(dataset);
  EXPECT_THAT(RenderFrame(dataset, "fake", 2, spec, 1),
              FailsWith(absl::StatusCode::kOutOfRange, "step 2"));
  EXPECT_THAT(RenderFrame(dataset, "fake", -1, spec, 1),
              FailsWith(absl::StatusCode::kOutOfRange, "step -1"));
}

TEST(StepAtTime, IsTheLastStepNotAfterTheTime) {
  FakeDataset dataset(5);
  const int64_t first = 2'000'000'000;
  EXPECT_EQ(*StepAtTime(dataset, first), 0);
  EXPECT_EQ(*StepAtTime(dataset, first + 499'999'999), 0);
  EXPECT_EQ(*StepAtTime(dataset, first + 500'000'000), 1);
  EXPECT_EQ(*StepAtTime(dataset, first + 2'000'000'000), 4);
  EXPECT_EQ(*StepAtTime(dataset, INT64_MAX), 4);
  EXPECT_THAT(StepAtTime(dataset, first - 1),
              FailsWith(absl::StatusCode::kOutOfRange, "before the first step"));
  FakeDataset empty(0);
  EXPECT_THAT(StepAtTime(empty, first), FailsWith(absl::StatusCode::kOutOfRange, "time_ns"));
}

}  // namespace
}  // namespace fovea::frames
