#include "service/export/naming.h"

#include "tests/support/status_matchers.h"

namespace fovea::exports {
namespace {

using ::fovea::testing::FailsWith;

TEST(FramePattern, PutsTheNumberWhereTheHashesAre) {
  ASSERT_OK_AND_ASSIGN(const FramePattern pattern, FramePattern::Parse("out/f.####.png"));
  EXPECT_EQ(pattern.PathOf(7), "out/f.0007.png");
  EXPECT_EQ(pattern.PathOf(12345), "out/f.12345.png");
  EXPECT_EQ(pattern.PathOf(-3), "out/f.-0003.png");
  EXPECT_EQ(pattern.PathOf(INT64_MIN), "out/f.-9223372036854775808.png");
  EXPECT_EQ(pattern.Stem(), "f");
}

TEST(FramePattern, UnderstandsPrintfsForm) {
  EXPECT_EQ(FramePattern::Parse("f_%04d.exr")->PathOf(21), "f_0021.exr");
  EXPECT_EQ(FramePattern::Parse("%d.exr")->PathOf(21), "21.exr");
  EXPECT_EQ(FramePattern::Parse("%d.exr")->Stem(), "");
  EXPECT_EQ(FramePattern::Parse("100%_f#.png")->PathOf(5), "100%_f5.png");
}

TEST(FramePattern, WantsExactlyOnePlaceInTheName) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  EXPECT_THAT(FramePattern::Parse("f.png"), FailsWith(kInvalid, "'f.png' has no place"));
  EXPECT_THAT(FramePattern::Parse("out####/f.png"), FailsWith(kInvalid, "no place"));
  EXPECT_THAT(FramePattern::Parse("f.##_##.png"), FailsWith(kInvalid, "more than one"));
  EXPECT_THAT(FramePattern::Parse("f.%s.png"), FailsWith(kInvalid, "no place"));
  EXPECT_THAT(FramePattern::Parse("f.%0999d.png"), FailsWith(kInvalid, "no place"));
}

}  // namespace
}  // namespace fovea::exports
