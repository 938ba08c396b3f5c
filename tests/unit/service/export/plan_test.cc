#include "service/export/exporter.h"
#include "tests/support/status_matchers.h"

namespace fovea::exports {
namespace {

using ::fovea::testing::FailsWith;

std::vector<StepInfo> Steps(const std::vector<std::optional<int64_t>>& numbers) {
  std::vector<StepInfo> steps;
  for (const auto& number : numbers) {
    const auto step = static_cast<int64_t>(steps.size());
    steps.push_back({step, step * 100, number});
  }
  return steps;
}

std::vector<std::string> Paths(const ExportOptions& options, const std::vector<StepInfo>& steps) {
  std::vector<std::string> paths;
  const auto planned = PlanFrames(options, steps, 100, {});
  EXPECT_OK(planned);
  for (const PlannedFrame& frame : *planned) {
    paths.push_back(frame.path);
  }
  return paths;
}

TEST(PlanFrames, NamesFramesByTheirNumberWhereAllHaveTheirOwn) {
  ExportOptions options;
  options.output = "f.##.png";
  using Names = std::vector<std::string>;
  EXPECT_EQ(Paths(options, Steps({21, 25})), (Names{"f.21.png", "f.25.png"}));
  EXPECT_EQ(Paths(options, Steps({std::nullopt, std::nullopt})), (Names{"f.00.png", "f.01.png"}));
  EXPECT_EQ(Paths(options, Steps({21, 21})), (Names{"f.00.png", "f.01.png"}));
}

TEST(PlanFrames, AnAnimationSpreadsOverTheStepsAndCountsItsOwnFrames) {
  ExportOptions options;
  options.output = "f.#.png";
  options.animation = frames::Animation::Orbit(0, 0, 90, 6);
  ASSERT_OK_AND_ASSIGN(const auto planned, PlanFrames(options, Steps({21, 25, 29}), 3, {}));
  ASSERT_EQ(planned.size(), 6U);
  EXPECT_EQ(planned[0].step, 0);
  EXPECT_EQ(planned[1].step, 0);
  EXPECT_EQ(planned[5].step, 2);
  EXPECT_EQ(planned[5].path, "f.5.png");
  EXPECT_EQ(planned[5].spec.view.azimuth_deg, 75);
}

TEST(PlanFrames, AnAnimationMustStayWithinTheSteps) {
  ExportOptions options;
  options.output = "shot.mp4";
  options.animation = *frames::Animation::Parse(
      R"({"frames": 3, "keys": [{"frame": 0, "step": 0}, {"frame": 2, "step": 8}]})");
  EXPECT_THAT(PlanFrames(options, Steps({1, 2, 3}), 3, {}),
              FailsWith(absl::StatusCode::kOutOfRange, "step 4 of the animation's frame 1"));
}

TEST(NaturalFrameRate, FollowsRegularTimesOnly) {
  const auto at = [](const std::vector<int64_t>& times) {
    std::vector<StepInfo> steps;
    for (const int64_t time : times) {
      steps.push_back({0, time, std::nullopt});
    }
    return NaturalFrameRate(steps);
  };
  EXPECT_EQ(at({5}), 24);
  EXPECT_EQ(at({0, 41666667, 83333333, 125000000}), 24);
  EXPECT_EQ(at({0, 166666667, 333333333}), 6);
  EXPECT_EQ(at({0, 40000000, 100000000}), 24);  // irregular
  EXPECT_EQ(at({0, 0, 0}), 24);                 // all at once
  EXPECT_EQ(at({0, 3600'000000000}), 24);       // an hour apart
}

TEST(ValidateExport, RefusesWhatCannotBeMeant) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  ExportOptions options;
  const auto with = [&](const std::string& output) {
    options.output = output;
    return ValidateExport(options);
  };
  EXPECT_OK(with("shot.webm"));
  EXPECT_OK(with("f.#.npy"));
  EXPECT_THAT(with("f.#.gif"), FailsWith(kInvalid, ".png .jpg"));
  EXPECT_THAT(with("f.png"), FailsWith(kInvalid, "no place"));
  options.spec.fovea_marker = true;
  EXPECT_OK(with("shot.mp4"));
  EXPECT_THAT(with("f.#.exr"), FailsWith(kInvalid, "fovea_marker"));
  options.spec.fovea_marker = false;
  options.shard_count = 2;
  EXPECT_OK(with("f.#.exr"));
  EXPECT_THAT(with("shot.mp4"), FailsWith(kInvalid, "shard 0/2"));
  options.shard_count = 1;
  options.frames_per_second = 0;
  EXPECT_THAT(with("shot.mp4"), FailsWith(kInvalid, "fps 0"));
}

}  // namespace
}  // namespace fovea::exports
