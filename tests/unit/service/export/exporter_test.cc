#include "service/export/exporter.h"

#include <csignal>
#include <filesystem>
#include <set>

#include "service/export/output_file.h"
#include "service/frames/frames.h"
#include "tests/support/decode.h"
#include "tests/support/fake_dataset.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::exports {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using ::fovea::testing::FakeDataset;
using ::fovea::testing::ReadFile;
using ::fovea::testing::TemporaryFolder;

/// Renders the fake dataset, and remembers which steps it was asked for.
class FakeProvider final : public FrameProvider {
 public:
  explicit FakeProvider(int64_t steps)
      : dataset_(steps), info_(dataset_.info()), defaults_(*frames::DefaultSpec(dataset_)) {}

  [[nodiscard]] const std::string& identity() const override { return identity_; }
  [[nodiscard]] const store::DatasetInfo& info() const override { return info_; }
  StatusOr<std::vector<StepInfo>> Describe(const std::vector<int64_t>& steps) override {
    std::vector<StepInfo> described;
    for (const int64_t step : steps) {
      described.push_back({step, *dataset_.TimeNs(step), *dataset_.FrameNumber(step)});
    }
    return described;
  }
  StatusOr<frames::FrameSpec> Resolve(const frames::FrameSpec& spec) override {
    return frames::ResolveSpec(dataset_, spec, defaults_);
  }
  StatusOr<frames::Frame> Render(int64_t step, const frames::FrameSpec& spec) override {
    rendered.push_back(step);
    return frames::RenderFrame(dataset_, "fake", step, spec, 1);
  }
  Status RenderEach(const std::vector<int64_t>& steps, const frames::FrameSpec& spec,
                    const std::function<Status(const frames::Frame&)>& on_frame) override {
    for (const int64_t step : steps) {
      FOVEA_ASSIGN_OR_RETURN(const frames::Frame frame, Render(step, spec));
      FOVEA_RETURN_IF_ERROR(on_frame(frame));
    }
    return absl::OkStatus();
  }

  std::vector<int64_t> rendered;

 private:
  FakeDataset dataset_;
  store::DatasetInfo info_;
  frames::FrameSpec defaults_;
  std::string identity_ = "fake.zarr#1";
};

class ExportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::signal(SIGPIPE, SIG_IGN);
    options.output = folder / "f.####.png";
    options.spec.width_px = 24;
    options.spec.height_px = 18;
  }
  StatusOr<ExportReport> Run() {
    provider.rendered.clear();
    return Export(provider, options, [this](const ExportProgress& now) {
      progress.push_back(now);
      return now.done < stop_after;
    });
  }
  std::set<std::string> Files() const {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder.path())) {
      names.insert(entry.path().filename().string());
    }
    return names;
  }

  TemporaryFolder folder;
  FakeProvider provider{5};
  ExportOptions options;
  std::vector<ExportProgress> progress;
  int64_t stop_after = 1000;
};

TEST_F(ExportTest, MakesOnePictureAStepNamedByItsNumber) {
  options.stride = 2;
  ASSERT_OK_AND_ASSIGN(const ExportReport report, Run());
  EXPECT_EQ(report.frames_made, 3);
  EXPECT_EQ(provider.rendered, (std::vector<int64_t>{0, 2, 4}));
  EXPECT_EQ(Files(), (std::set<std::string>{".f.png.fovea-export.json", "f.0100.png", "f.0104.png",
                                            "f.0108.png"}));
  EXPECT_EQ(testing::DecodePng(ReadFile(folder / "f.0104.png")).width, 24);
  EXPECT_EQ(report.first_path, folder / "f.0100.png");
  EXPECT_EQ(report.last_path, folder / "f.0108.png");
  ASSERT_EQ(progress.size(), 3U);
  EXPECT_EQ(progress[2].done, 3);
  EXPECT_EQ(progress[2].total, 3);
}

TEST_F(ExportTest, GoesOnWhereItStopped) {
  stop_after = 2;
  EXPECT_THAT(Run(), FailsWith(absl::StatusCode::kCancelled, "stopped after 2 of 5 frames"));
  stop_after = 1000;
  ASSERT_OK_AND_ASSIGN(const ExportReport report, Run());
  EXPECT_EQ(report.frames_skipped, 2);
  EXPECT_EQ(report.frames_made, 3);
  EXPECT_EQ(provider.rendered, (std::vector<int64_t>{2, 3, 4}));
  ASSERT_FALSE(report.notes.empty());
  EXPECT_NE(report.notes[0].find("2 of 5 frames were done already"), std::string::npos);
  ASSERT_OK_AND_ASSIGN(const ExportReport nothing, Run());
  EXPECT_EQ(nothing.frames_made, 0);
}

TEST_F(ExportTest, ChangedSettingsAndOverwriteMakeEverythingAgain) {
  ASSERT_OK(Run());
  options.spec.rate = 9;
  ASSERT_OK_AND_ASSIGN(const ExportReport changed, Run());
  EXPECT_EQ(changed.frames_made, 5);
  EXPECT_NE(changed.notes.at(0).find("other settings"), std::string::npos);
  EXPECT_EQ(Run()->frames_made, 0);
  options.overwrite = true;
  EXPECT_EQ(Run()->frames_made, 5);
  options.overwrite = false;
  options.first = 1;  // another range needs no new pictures
  EXPECT_EQ(Run()->frames_made, 0);
}

TEST_F(ExportTest, LeavesFilesAloneThatItDidNotMake) {
  ASSERT_OK(WriteWholeFile(folder / "f.0102.png", "precious"));
  EXPECT_THAT(Run(), FailsWith(absl::StatusCode::kAlreadyExists, "f.0102.png exists"));
  EXPECT_EQ(ReadFile(folder / "f.0102.png"), "precious");
  options.overwrite = true;
  EXPECT_OK(Run());
  EXPECT_NE(ReadFile(folder / "f.0102.png"), "precious");
}

TEST_F(ExportTest, ShardsTogetherMakeEachFrameOnce) {
  options.shard_count = 2;
  EXPECT_EQ(Run()->frames_made, 3);
  EXPECT_EQ(provider.rendered, (std::vector<int64_t>{0, 2, 4}));
  options.shard_index = 1;
  EXPECT_EQ(Run()->frames_made, 2);
  EXPECT_EQ(provider.rendered, (std::vector<int64_t>{1, 3}));
  options.shard_count = 1;
  options.shard_index = 0;
  EXPECT_EQ(Run()->frames_made, 0);
  options.shard_count = 9;
  options.shard_index = 7;
  EXPECT_EQ(Run()->frames_total, 0);
}

TEST_F(ExportTest, AnAnimationIsCheckedBeforeItsFirstFrame) {
  options.animation = *frames::Animation::Parse(R"({"frames": 4, "keys": [
    {"frame": 0, "fovea": [10, 10, 10]}, {"frame": 3, "fovea": [10, 10, 100]}]})");
  EXPECT_THAT(Run(), FailsWith(absl::StatusCode::kInvalidArgument, "frame 2 of the animation"));
  EXPECT_TRUE(Files().empty());
}

TEST_F(ExportTest, AnAnimationsFramesDifferAndAreRemembered) {
  options.animation = frames::Animation::Orbit(0, 0, 180, 3);
  options.last = 0;
  ASSERT_OK(Run());
  EXPECT_NE(ReadFile(folder / "f.0000.png"), ReadFile(folder / "f.0001.png"));
  EXPECT_EQ(Run()->frames_made, 0);
  options.animation = frames::Animation::Orbit(0, 0, 90, 3);
  EXPECT_EQ(Run()->frames_made, 3);
}

TEST_F(ExportTest, RefusesStepsThatAreNotThere) {
  options.first = 5;
  EXPECT_THAT(Run(), FailsWith(absl::StatusCode::kOutOfRange, "include 5, which is not there"));
  options.first = 0;
  options.last = 7;
  EXPECT_THAT(Run(), FailsWith(absl::StatusCode::kOutOfRange, "the dataset has 0 to 4"));
}

TEST_F(ExportTest, MoviesAreWholeOrNotThere) {
  options.output = folder / "shot.mp4";
  stop_after = 3;
  EXPECT_THAT(Run(), FailsWith(absl::StatusCode::kCancelled, "not kept"));
  EXPECT_FALSE(fs::exists(options.output));
  stop_after = 1000;
  ASSERT_OK_AND_ASSIGN(const ExportReport report, Run());
  EXPECT_EQ(report.frames_made, 5);
  EXPECT_EQ(report.frames_per_second, 2);  // half a second a step
  EXPECT_TRUE(fs::exists(options.output));
  ASSERT_OK_AND_ASSIGN(const ExportReport again, Run());
  EXPECT_EQ(again.frames_made, 0);
  EXPECT_EQ(again.frames_skipped, 5);
  options.last = 2;  // a movie of other steps is another movie
  EXPECT_EQ(Run()->frames_made, 3);
}

}  // namespace
}  // namespace fovea::exports
