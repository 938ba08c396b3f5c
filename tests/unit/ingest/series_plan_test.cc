#include "ingest/series_plan.h"

#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

GridInfo Grid(const std::string& name, const Box3& box, double voxel_size = 0.5) {
  GridInfo grid{name, "float", "", box, {}, 1000};
  grid.index_to_world.m = {voxel_size, 0, 0,          10, 0, voxel_size, 0, 20,
                           0,          0, voxel_size, 30, 0, 0,          0, 1};
  return grid;
}

ScannedFile File(int64_t number, std::vector<GridInfo> grids) {
  return {{"f" + std::to_string(number) + ".vdb", number, false}, {1, ""}, std::move(grids)};
}

const Box3 kA{{0, 0, 0}, {10, 20, 30}};
const Box3 kB{{-5, 1, 1}, {6, 7, 40}};

TEST(PlanSeriesTest, TheExtentIsTheUnionAndVoxelsBeginHalfABeforeTheirCentre) {
  const IngestOptions options;
  ASSERT_OK_AND_ASSIGN(const SeriesPlan plan,
                       PlanSeries(options,
                                  {File(1, {Grid("density", kA), Grid("heat", {})}),
                                   File(2, {Grid("density", {}), Grid("heat", kB)})},
                                  {}));
  EXPECT_THAT(plan.fields, ElementsAre("density", "heat"));
  EXPECT_EQ(plan.extent, (Box3{{-5, 0, 0}, {10, 20, 40}}));
  EXPECT_EQ(plan.index_to_world.TransformPoint({0, 0, 0}), (Vec3{10 - 2.75, 19.75, 29.75}));
  EXPECT_EQ(plan.index_to_world.Spacing(), (Vec3{0.5, 0.5, 0.5}));
  ASSERT_EQ(plan.steps.size(), 2U);
  EXPECT_EQ(plan.steps[1].frame_number, 2);
  EXPECT_EQ(plan.steps[1].sources[1], (FieldSource{"f2.vdb", "heat", 0, 1}));
  EXPECT_THAT(plan.warnings, ElementsAre(HasSubstr("'density' is empty (all background) in 1 of 2"),
                                         HasSubstr("'heat' is empty")));
}

TEST(PlanSeriesTest, TimesAreNumbersOverTheRate) {
  IngestOptions options;
  options.frames_per_second = 25;
  ASSERT_OK_AND_ASSIGN(
      SeriesPlan plan,
      PlanSeries(options, {File(10, {Grid("d", kA)}), File(20, {Grid("d", kA)})}, {}));
  EXPECT_EQ(plan.steps[0].time_ns, 400'000'000);
  EXPECT_EQ(plan.steps[1].time_ns, 800'000'000);
  auto unnumbered = File(10, {Grid("d", kA)});
  unnumbered.file.frame_number.reset();
  ASSERT_OK_AND_ASSIGN(plan, PlanSeries(options, {unnumbered, unnumbered}, {}));
  EXPECT_EQ(plan.steps[0].time_ns, 0);
  EXPECT_EQ(plan.steps[1].time_ns, 40'000'000);
  EXPECT_EQ(plan.steps[1].frame_number, std::nullopt);
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    options.frames_per_second = bad;
    EXPECT_THAT(PlanSeries(options, {unnumbered}, {}), FailsWith(kInvalid, "frames a second"));
  }
  options.frames_per_second = 1e-9;
  EXPECT_THAT(PlanSeries(options, {File(100'000'000, {Grid("d", kA)})}, {}),
              FailsWith(kInvalid, "range of time"));
}

TEST(PlanSeriesTest, AMissingGridIsAnErrorOrSkippedOrHeld) {
  const std::vector<ScannedFile> files{File(1, {Grid("d", kA), Grid("t", kA)}),
                                       File(2, {Grid("d", kA)}),
                                       File(3, {Grid("d", kA), Grid("t", kA)})};
  IngestOptions options;
  EXPECT_THAT(PlanSeries(options, files, {}),
              FailsWith(absl::StatusCode::kNotFound, "f2.vdb: there is no grid 't'"));
  options.on_missing = OnMissing::kSkip;
  ASSERT_OK_AND_ASSIGN(const SeriesPlan skipped, PlanSeries(options, files, {}));
  EXPECT_EQ(skipped.steps.size(), 2U);
  EXPECT_THAT(skipped.warnings, ElementsAre(HasSubstr("'f2.vdb' is left out")));
  options.on_missing = OnMissing::kHold;
  ASSERT_OK_AND_ASSIGN(const SeriesPlan held, PlanSeries(options, files, {}));
  ASSERT_EQ(held.steps.size(), 3U);
  EXPECT_EQ(held.steps[1].sources[0].path, "f2.vdb");
  EXPECT_EQ(held.steps[1].sources[1].path, "f1.vdb");
  EXPECT_EQ(held.steps[1].frame_number, 2);
  EXPECT_THAT(PlanSeries(options, {files[1], files[0]}, {}),
              FailsWith(absl::StatusCode::kNotFound, "no step before it"));
}

TEST(PlanSeriesTest, TransformsThatDifferBetweenStepsAreAnErrorThatSaysHow) {
  const IngestOptions options;
  EXPECT_THAT(
      PlanSeries(options, {File(1, {Grid("d", kA, 0.5)}), File(2, {Grid("d", kA, 0.25)})}, {}),
      FailsWith(kInvalid, "voxel size (0.5, 0.5, 0.5) and (0.25, 0.25, 0.25)"));
  GridInfo moved = Grid("d", kA);
  moved.index_to_world.m[7] += 0.25;
  EXPECT_THAT(PlanSeries(options, {File(1, {Grid("d", kA)}), File(2, {moved})}, {}),
              FailsWith(kInvalid, "origin (10, 20, 30) and (10, 20.25, 30)"));
  GridInfo turned = Grid("d", kA);
  turned.index_to_world.m[0] = 0;
  turned.index_to_world.m[1] = 0.5;
  turned.index_to_world.m[4] = -0.5;
  turned.index_to_world.m[5] = 0;
  EXPECT_THAT(PlanSeries(options, {File(1, {Grid("d", kA)}), File(2, {turned})}, {}),
              FailsWith(kInvalid, "directions of the axes"));
  GridInfo close = Grid("d", kA);
  close.index_to_world.m[7] *= 1 + 1e-8;
  EXPECT_OK(PlanSeries(options, {File(1, {Grid("d", kA)}), File(2, {close})}, {}));
}

TEST(PlanSeriesTest, AnEmptyGridsTransformMeansNothing) {
  EXPECT_OK(PlanSeries({}, {File(1, {Grid("d", kA)}), File(2, {Grid("d", {}, 7)})}, {}));
}

TEST(PlanSeriesTest, GridsThatLieOtherwiseFromTheStartAreLeftOutUnlessAskedFor) {
  const std::vector<ScannedFile> files{File(1, {Grid("heat", kA, 1), Grid("density", kA, 0.5)})};
  IngestOptions options;
  ASSERT_OK_AND_ASSIGN(const SeriesPlan plan, PlanSeries(options, files, {}));
  EXPECT_THAT(plan.fields, ElementsAre("density"));
  EXPECT_THAT(plan.warnings, ElementsAre(HasSubstr("grid 'heat' is left out")));
  options.grids = {"heat", "density"};
  EXPECT_THAT(PlanSeries(options, files, {}), FailsWith(kInvalid, "voxel size"));
}

TEST(PlanSeriesTest, ExtentsThatAreEmptyOrTooLargeAreRefused) {
  EXPECT_THAT(PlanSeries({}, {File(1, {Grid("d", {})})}, {}), FailsWith(kInvalid, "no step"));
  const Box3 far{{1'000'000, 0, 0}, {1'000'001, 1, 1}};
  EXPECT_THAT(PlanSeries({}, {File(1, {Grid("d", kA)}), File(2, {Grid("d", far)})}, {}),
              FailsWith(absl::StatusCode::kOutOfRange, "f2.vdb: grid 'd': with it"));
}

class AppendPlanTest : public ::testing::Test {
 protected:
  AppendPlanTest() {
    store::DatasetInfo info;
    info.hierarchy = *Hierarchy::Make({10, 20, 30});
    info.index_to_world = Grid("d", kA).index_to_world;
    for (size_t i = 0; i < 3; ++i) {
      info.index_to_world.m[4 * i + 3] -= 0.25;
    }
    info.fields = {{"d", "float32", 0, 1}, {"t", "float32", 0, 1}};
    info.committed_steps = 2;
    existing_ = ExistingStore{info, 1'000'000'000};
  }
  IngestOptions options_;
  std::optional<ExistingStore> existing_;
};

TEST_F(AppendPlanTest, TakesTheStoresFieldsAndExtent) {
  const Box3 small{{2, 2, 2}, {3, 3, 3}};
  ASSERT_OK_AND_ASSIGN(
      const SeriesPlan plan,
      PlanSeries(options_, {File(48, {Grid("t", small), Grid("x", kB), Grid("d", small)})},
                 existing_));
  EXPECT_THAT(plan.fields, ElementsAre("d", "t"));
  EXPECT_EQ(plan.extent, kA);
  EXPECT_THAT(plan.warnings, IsEmpty());
}

TEST_F(AppendPlanTest, RefusesWhatDoesNotFit) {
  EXPECT_THAT(PlanSeries(options_, {File(48, {Grid("t", kB), Grid("d", kA)})}, existing_),
              FailsWith(kInvalid, "grid 't' reaches from (-5, 1, 1) to (5, 6, 39)"));
  EXPECT_THAT(PlanSeries(options_, {File(48, {Grid("d", kA)})}, existing_),
              FailsWith(absl::StatusCode::kNotFound, "'t'"));
  EXPECT_THAT(PlanSeries(options_, {File(48, {Grid("t", kA, 1), Grid("d", kA, 1)})}, existing_),
              FailsWith(kInvalid, "do not lie as"));
  EXPECT_THAT(PlanSeries(options_, {File(3, {Grid("t", kA), Grid("d", kA)})}, existing_),
              FailsWith(kInvalid, "steps are added in order"));
  options_.grids = {"d"};
  EXPECT_THAT(PlanSeries(options_, {File(48, {Grid("t", kA), Grid("d", kA)})}, existing_),
              FailsWith(kInvalid, "has the fields d, t"));
}

TEST_F(AppendPlanTest, UnnumberedStepsGoOnCounting) {
  existing_->last_time_ns = 41'666'667;
  auto file = File(0, {Grid("d", kA), Grid("t", kA)});
  file.file.frame_number.reset();
  ASSERT_OK_AND_ASSIGN(const SeriesPlan plan, PlanSeries(options_, {file}, existing_));
  EXPECT_EQ(plan.steps[0].time_ns, 83'333'333);
}

ScannedFile DenseFile(int64_t number, int64_t steps, std::vector<double> times = {}) {
  GridInfo grid{"", "uint8", "", Box3::OfSize({4, 5, 6}), {}, 0, "K"};
  grid.index_to_world.m = {1, 0, 0, 0.5, 0, 1, 0, 0.5, 0, 0, 1, 0.5, 0, 0, 0, 1};
  ScannedFile file = File(number, {grid});
  file.info.is_dense = true;
  file.info.steps = steps;
  file.info.times_s = std::move(times);
  return file;
}

TEST(PlanDenseTest, StepsOfAFileHaveNoFrameNumberOfTheirOwn) {
  IngestOptions options;
  options.spacing = {1, 2, 3};
  ScannedFile file = DenseFile(7, 3);
  file.file.further = {"f7.raw.json"};
  file.info.warnings = {"odd"};
  ASSERT_OK_AND_ASSIGN(const SeriesPlan plan, PlanSeries(options, {file}, {}));
  ASSERT_EQ(plan.steps.size(), 3U);
  EXPECT_EQ(plan.steps[2].sources[0].step_in_file, 2);
  EXPECT_EQ(plan.steps[2].frame_number, std::nullopt);
  EXPECT_EQ(plan.index_to_world.Spacing(), (Vec3{1, 2, 3}));
  EXPECT_EQ(plan.index_to_world.TransformPoint({0, 0, 0}), (Vec3{0, 0, 0}));
  EXPECT_THAT(plan.source_types, ElementsAre("uint8"));
  EXPECT_THAT(plan.value_units, ElementsAre("K"));
  EXPECT_THAT(plan.file_sets, ElementsAre(ElementsAre("f7.vdb", "f7.raw.json")));
  EXPECT_THAT(plan.warnings, ElementsAre("odd"));
  options.spacing = {1, 0, 1};
  EXPECT_THAT(PlanSeries(options, {file}, {}), FailsWith(kInvalid, "spacing"));
  options.spacing = {1, 1, 1};
  options.field = "a/b";
  EXPECT_THAT(PlanSeries(options, {file}, {}), FailsWith(kInvalid, "field name"));
}

TEST(PlanDenseTest, StepsAreOfOneSizeAndKind) {
  ScannedFile other = DenseFile(2, 1);
  other.grids[0].box.hi.x = 3;
  EXPECT_THAT(PlanSeries({}, {DenseFile(1, 1), other}, {}),
              FailsWith(kInvalid, "f2.vdb: has 3 x 5 x 6 voxels, but 'f1.vdb' has 4 x 5 x 6"));
  EXPECT_THAT(PlanSeries({}, {DenseFile(1, 1), File(2, {Grid("d", kA)})}, {}),
              FailsWith(kInvalid, "different kinds"));
  other = DenseFile(2, 1);
  other.grids[0].type = "int16";
  ASSERT_OK_AND_ASSIGN(const SeriesPlan plan, PlanSeries({}, {DenseFile(1, 1), other}, {}));
  EXPECT_THAT(plan.source_types, ElementsAre("mixed"));
}

TEST(PlanDenseTest, TimesAreThoseAskedForThenThoseOfTheRateThenThoseOfTheFiles) {
  const std::vector<ScannedFile> files{DenseFile(1, 2, {0.5, 1}), DenseFile(2, 1, {4})};
  const auto times = [](const SeriesPlan& plan) {
    std::vector<double> seconds;
    for (const PlannedStep& step : plan.steps) {
      seconds.push_back(static_cast<double>(step.time_ns) * 1e-9);
    }
    return seconds;
  };
  IngestOptions options;
  ASSERT_OK_AND_ASSIGN(SeriesPlan plan, PlanSeries(options, files, {}));
  EXPECT_THAT(times(plan), ElementsAre(0.5, 1, 4));
  options.frames_per_second = 2;
  ASSERT_OK_AND_ASSIGN(plan, PlanSeries(options, files, {}));
  EXPECT_THAT(times(plan), ElementsAre(0, 0.5, 1));
  options.times_s = {1, 1, 8};
  ASSERT_OK_AND_ASSIGN(plan, PlanSeries(options, files, {}));
  EXPECT_THAT(times(plan), ElementsAre(1, 1, 8));
  options.times_s = {1, 2};
  EXPECT_THAT(PlanSeries(options, files, {}), FailsWith(kInvalid, "--times: 2 times for 3 steps"));
  options.times_s = {1, 3, 2};
  EXPECT_THAT(PlanSeries(options, files, {}), FailsWith(kInvalid, "at 2 s, before the last step"));
  // Files that all begin at 0 do not say when they are.
  ASSERT_OK_AND_ASSIGN(plan, PlanSeries({}, {DenseFile(24, 1, {0}), DenseFile(48, 1, {0})}, {}));
  EXPECT_THAT(times(plan), ElementsAre(1, 2));
}

}  // namespace
}  // namespace fovea::ingest
