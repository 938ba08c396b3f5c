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
