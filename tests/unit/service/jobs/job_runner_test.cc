#include "service/jobs/job_runner.h"

#include <sys/mount.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <random>

#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::jobs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using ::fovea::testing::FailsWith;
using Clock = std::chrono::steady_clock;
constexpr int64_t kNewest = std::numeric_limits<int64_t>::max();

/// Waits for what a job tells.
class Listener : public JobListener {
 public:
  void OnJob(const Job& job) override {
    const std::lock_guard lock(mutex_);
    last_ = job;
    changed_.notify_all();
  }
  void OnClosing() override {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    changed_.notify_all();
  }
  template <typename Condition>
  Job Until(Condition condition) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, 60s, [&] { return closing_ || (last_ && condition(*last_)); });
    return last_.value_or(Job());
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Job> last_;
  bool closing_ = false;
};

class JobRunnerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"root", "in", "out"}) {
      fs::create_directories(folder_.Path(name));
    }
    Open();
  }
  RunnerOptions Options() {
    return {.state = folder_.Path("state"),
            .folders = {.root = folder_.Path("root"),
                        .ingest_root = folder_.Path("in"),
                        .export_root = folder_.Path("out")},
            .threads = 2};
  }
  void Open() { Open(Options()); }
  void Open(const RunnerOptions& options) {
    auto runner = JobRunner::Open(options);
    ASSERT_OK(runner.status());
    runner_ = *std::move(runner);
  }
  /// Headerless bytes that no codec makes small.
  void WriteRaw(const std::string& name, int64_t bytes, unsigned seed) {
    std::mt19937 random(seed);
    std::string voxels(static_cast<size_t>(bytes), '\0');
    for (char& voxel : voxels) {
      voxel = static_cast<char>(random());
    }
    std::ofstream(folder_.Path("in/" + name), std::ios::binary) << voxels;
  }
  void WriteSeries(int steps) {
    for (int i = 0; i < steps; ++i) {
      WriteRaw(fmt::format("s_{:02}.raw", i), kEdge * kEdge * kEdge, static_cast<unsigned>(i));
    }
  }
  StatusOr<Job> Ingest(const std::string& files, const std::string& raw,
                       const std::string& owner = "") {
    v1::IngestFilesRequest request;
    request.set_dataset("made");
    request.add_files(files);
    request.set_raw(raw);
    Job job;
    job.owner = owner;
    job.dataset = "made";
    job.request = request.SerializeAsString();
    return runner_->Create(job);
  }
  StatusOr<Job> Export(const std::string& output, bool strict) {
    v1::CreateExportRequest request;
    request.set_dataset("ball");
    request.set_output(output);
    request.mutable_spec()->set_width_px(32);
    request.mutable_spec()->set_height_px(32);
    request.mutable_spec()->set_strict(strict);
    Job job;
    job.kind = Kind::kExport;
    job.dataset = "ball";
    job.target = output;
    job.request = request.SerializeAsString();
    return runner_->Create(job);
  }
  /// Four steps, with these chunks of it damaged.
  void MakeDamagedBall(const std::string& array, const std::string& chunks) {
    const std::string path = folder_.Path("root/ball.zarr");
    ASSERT_OK(store::testing::MakeStore(path, store::testing::MakeInfo({40, 36, 30}, 16), 4));
    int damaged = 0;
    for (const std::string& file : store::testing::FilesBelow(path)) {
      const std::string name = fs::path(file).filename().string();
      if (file.find(array) != std::string::npos && name.starts_with(chunks)) {
        store::testing::FlipByte(file, 4);
        ++damaged;
      }
    }
    ASSERT_GT(damaged, 0);
  }
  template <typename Condition>
  Job Until(const StatusOr<Job>& job, Condition condition) {
    EXPECT_OK(job.status());
    const auto listener = std::make_shared<Listener>();
    EXPECT_OK(runner_->Watch(job->owner, job->id, listener));
    return listener->Until(condition);
  }
  Job Ended(const StatusOr<Job>& job) {
    return Until(job, [](const Job& now) { return IsEnd(now.state); });
  }
  [[nodiscard]] std::string Made() const { return folder_.Path("root/made.zarr"); }
  /// What `fovea ingest` makes of the series, file by file.
  void ExpectAsPlainIngest() {
    ingest::IngestOptions options;
    options.inputs = {folder_.Path("in/s_##.raw")};
    options.output = folder_.Path("plain.zarr");
    options.raw = *ingest::ParseRawFormat(kRaw);
    options.threads = 2;
    ASSERT_OK(ingest::Ingest(options).status());
    const auto files = store::testing::FilesBelow(Made());
    const auto plain = store::testing::FilesBelow(options.output);
    ASSERT_EQ(files.size(), plain.size());
    for (size_t i = 0; i < files.size(); ++i) {
      EXPECT_EQ(fs::relative(files[i], Made()), fs::relative(plain[i], options.output));
      EXPECT_TRUE(Bytes(files[i]) == Bytes(plain[i])) << files[i];
    }
  }
  static std::string Bytes(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  static constexpr int64_t kEdge = 64;
  static constexpr char kRaw[] = "64x64x64:uint8";
  store::testing::TemporaryFolder folder_;
  std::unique_ptr<JobRunner> runner_;
};

TEST_F(JobRunnerTest, AnIngestIsAsAPlainOne) {
  WriteSeries(3);
  const Job job = Ended(Ingest("s_##.raw", kRaw));
  EXPECT_EQ(job.state, State::kDone) << job.message;
  EXPECT_EQ(job.progress, (Progress{3, 3, 0}));
  EXPECT_TRUE(job.started_ms && job.ended_ms && *job.started_ms <= *job.ended_ms);
  EXPECT_EQ(runner_->Get("", job.id)->state, State::kDone);
  ExpectAsPlainIngest();
}

TEST_F(JobRunnerTest, AJobThatWasStoppedGoesOnAtTheNextStart) {
  WriteSeries(90);  // far from done when it is stopped
  const auto job = Ingest("s_##.raw", kRaw);
  const Job before = Until(job, [](const Job& now) { return now.progress.total > 0; });
  runner_->Stop();
  EXPECT_FALSE(IsEnd(before.state));
  runner_.reset();
  Open();
  const Job after = Ended(job);
  EXPECT_EQ(after.state, State::kDone) << after.message;
  EXPECT_EQ(after.progress, (Progress{90, 90, 0}));
  ExpectAsPlainIngest();
}

TEST_F(JobRunnerTest, CancelEndsALongStep) {
  std::ofstream(folder_.Path("in/large.raw"));
  // Seconds of work, a multiple of what is left to a step that is cancelled.
  fs::resize_file(folder_.Path("in/large.raw"), int64_t{1600} * 1600 * 1600);
  const auto job = Ingest("large.raw", "1600x1600x1600:uint8");
  Until(job, [](const Job& now) { return now.progress.total > 0; });  // the step has begun
  const auto start = Clock::now();
  ASSERT_OK(runner_->Cancel("", job->id).status());
  const Job ended = Ended(job);
  EXPECT_LT(Clock::now() - start, 3s);  // a second, and room for a machine that does more
  EXPECT_EQ(ended.state, State::kCancelled);
  EXPECT_FALSE(fs::exists(Made()));
}

TEST_F(JobRunnerTest, AJobThatWaitsIsCancelledAtOnceAndOneThatEndedStays) {
  WriteSeries(6);
  const auto first = Ingest("s_##.raw", kRaw);
  const auto second = Ingest("s_##.raw", kRaw);
  EXPECT_EQ(runner_->Cancel("", second->id)->state, State::kCancelled);
  EXPECT_EQ(Ended(first).state, State::kDone);
  EXPECT_EQ(runner_->Cancel("", first->id)->state, State::kDone);
  EXPECT_EQ(runner_->Get("", second->id)->state, State::kCancelled);
}

TEST_F(JobRunnerTest, AFileThatCannotBeReadIsNamed) {
  WriteSeries(4);
  fs::resize_file(folder_.Path("in/s_02.raw"), 1000);
  const Job job = Ended(Ingest("s_##.raw", kRaw));
  EXPECT_EQ(job.state, State::kFailed);
  EXPECT_EQ(job.progress.failed, 1);
  ASSERT_EQ(job.failures.size(), 1);
  EXPECT_EQ(job.failures[0].file, "s_02.raw");
  EXPECT_EQ(job.message, "s_02.raw: " + job.failures[0].reason);
  EXPECT_EQ(job.message.find(folder_.Path("in")), std::string::npos) << job.message;
  EXPECT_EQ(runner_->Get("", job.id)->failures, job.failures);
  WriteRaw("s_02.raw", kEdge * kEdge * kEdge, 2);
  EXPECT_EQ(Ended(Ingest("s_##.raw", kRaw)).state, State::kDone);
  ExpectAsPlainIngest();
}

TEST_F(JobRunnerTest, WhatIsNoFilesFaultBlamesNone) {
  ASSERT_OK(store::testing::MakeStore(Made(), store::testing::MakeInfo({40, 36, 30}, 16), 4));
  WriteSeries(2);
  const Job job = Ended(Ingest("s_##.raw", kRaw));
  EXPECT_EQ(job.state, State::kFailed);
  EXPECT_NE(job.message.find("made.zarr' is there already"), std::string::npos) << job.message;
  EXPECT_NE(job.message.find("a job has no --append"), std::string::npos) << job.message;
  EXPECT_EQ(job.progress, Progress());  // the four steps there are not this series'
  EXPECT_TRUE(job.failures.empty());
}

TEST_F(JobRunnerTest, FilesOutsideOfTheRootAreNotThere) {
  std::ofstream(folder_.Path("secret.raw")) << std::string(64, 'x');
  fs::create_symlink(folder_.Path("secret.raw"), folder_.Path("in/link.raw"));
  fs::create_directory_symlink(folder_.Path("."), folder_.Path("in/up"));
  for (const char* name : {"link.raw", "../secret.raw", "up/secret.raw", "*.raw"}) {
    const Job job = Ended(Ingest(name, "4x4x4:uint8"));
    EXPECT_EQ(job.state, State::kFailed) << name;
    EXPECT_NE(job.message.find("is not there"), std::string::npos) << job.message;
    EXPECT_FALSE(fs::exists(Made()));
  }
}

/// A small disk of its own, where one may be made.
class SmallDisk {
 public:
  explicit SmallDisk(std::string path) : path_(std::move(path)) {
    is_there_ = ::mount("tmpfs", path_.c_str(), "tmpfs", 0, "size=512k") == 0;
  }
  ~SmallDisk() {
    if (is_there_) {
      ::umount2(path_.c_str(), MNT_DETACH);
    }
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  [[nodiscard]] bool is_there() const { return is_there_; }
  void Grow() const {
    EXPECT_EQ(::mount("tmpfs", path_.c_str(), "tmpfs", MS_REMOUNT, "size=64m"), 0);
  }

 private:
  const std::string path_;
  bool is_there_ = false;
};

TEST_F(JobRunnerTest, AFullDiskEndsTheJobAndSaysWhy) {
  const SmallDisk disk(folder_.Path("root"));
  if (!disk.is_there()) {
    GTEST_SKIP() << "needs the right to mount";
  }
  WriteSeries(4);
  const Job job = Ended(Ingest("s_##.raw", kRaw));
  EXPECT_EQ(job.state, State::kFailed);
  EXPECT_NE(job.message.find("No space left"), std::string::npos) << job.message;
  EXPECT_EQ(job.progress.failed, 0);  // it is no file's fault
  disk.Grow();
  EXPECT_EQ(Ended(Ingest("s_##.raw", kRaw)).state, State::kDone);
  ExpectAsPlainIngest();
}

TEST_F(JobRunnerTest, AFullStateFolderRefusesJobsAndStopsNone) {
  runner_.reset();
  const SmallDisk disk(folder_.Path("state"));
  if (!disk.is_there()) {
    GTEST_SKIP() << "needs the right to mount";
  }
  Open();
  WriteSeries(1);
  const auto job = Ingest("s_##.raw", kRaw);
  std::ofstream(folder_.Path("state/filler")) << std::string(1 << 20, 'x');
  EXPECT_THAT(Ingest("s_##.raw", kRaw).status(),
              FailsWith(absl::StatusCode::kResourceExhausted, "disk is full"));
  // What it has done is told though its end cannot be written.
  const Job made = Until(job, [](const Job& now) { return now.progress.done == 1; });
  EXPECT_EQ(made.progress.done, 1);
  EXPECT_FALSE(IsEnd(made.state));
  disk.Grow();
  EXPECT_EQ(Ended(job).state, State::kDone);
  EXPECT_OK(Ingest("s_##.raw", kRaw).status());
}

TEST_F(JobRunnerTest, AnExportGoesOnAfterFramesThatCannotBeMade) {
  MakeDamagedBall("density/coarse", "c.2.");
  const Job job = Ended(Export("shot/f.##.png", true));
  EXPECT_EQ(job.state, State::kDone) << job.message;
  EXPECT_EQ(job.progress, (Progress{3, 4, 1}));
  ASSERT_EQ(job.failures.size(), 1);
  EXPECT_EQ(job.failures[0].file, "shot/f.102.png");
  EXPECT_TRUE(fs::exists(folder_.Path("out/shot/f.03.png")));
  EXPECT_FALSE(fs::exists(folder_.Path("out/shot/f.102.png")));
}

TEST_F(JobRunnerTest, WhatIsMissingInAPictureIsToldAndKept) {
  MakeDamagedBall("density/detail", "c.1.");
  for (const char* output : {"f.##.png", "f.mp4"}) {
    const Job job = Ended(Export(output, false));
    EXPECT_EQ(job.state, State::kDone) << job.message;
    EXPECT_EQ(job.progress, (Progress{4, 4, 0}));
    ASSERT_EQ(job.warnings.size(), 1) << output;
    EXPECT_NE(job.warnings[0].find("damaged chunks of 'density' at step 1"), std::string::npos)
        << job.warnings[0];
    EXPECT_EQ(runner_->Get("", job.id)->warnings, job.warnings);
  }
}

TEST_F(JobRunnerTest, WarningsAreKeptOnceEachAndSoMany) {
  const std::string program = folder_.Path("warns");
  std::ofstream(program) << R"(#!/bin/sh
cat > /dev/null
for i in $(seq 0 399); do printf '{"warning":"%s\\n"}\n' $((i % 200)); done
printf '{"code":0,"message":""}\n'
)";
  fs::permissions(program, fs::perms::owner_all);
  runner_.reset();
  RunnerOptions options = Options();
  options.program = program;
  Open(options);
  const Job job = Ended(Export("f.#.png", false));
  ASSERT_EQ(job.warnings.size(), kMaxWarnings);
  EXPECT_EQ(job.warnings[0], "0\\x0a");
  EXPECT_EQ(job.warnings[98], "98\\x0a");
  EXPECT_EQ(job.warnings[99], "further warnings are left out");
}

TEST_F(JobRunnerTest, AnothersJobIsNotThere) {
  WriteSeries(1);
  const auto job = Ingest("s_##.raw", kRaw, "lab");
  EXPECT_OK(runner_->Get("lab", job->id).status());
  EXPECT_THAT(runner_->Get("other", job->id), FailsWith(absl::StatusCode::kNotFound, "no job"));
  EXPECT_THAT(runner_->Cancel("other", job->id), FailsWith(absl::StatusCode::kNotFound, "no job"));
  const auto listener = std::make_shared<Listener>();
  EXPECT_THAT(runner_->Watch("other", job->id, listener),
              FailsWith(absl::StatusCode::kNotFound, "no job"));
  EXPECT_TRUE(runner_->List("other", kNewest, 10)->empty());
  EXPECT_EQ(Ended(job).state, State::kDone);
  EXPECT_THAT(runner_->Get("other", job->id), FailsWith(absl::StatusCode::kNotFound, "no job"));
}

TEST_F(JobRunnerTest, AStateFolderHasOneServer) {
  RunnerOptions options = Options();
  options.lock_limit = 0ms;
  EXPECT_THAT(JobRunner::Open(options).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "another server"));
  options.folders.export_root = folder_.Path("none");
  EXPECT_THAT(JobRunner::Open(options).status(),
              FailsWith(absl::StatusCode::kNotFound, "--export-root"));
  fs::create_directories(folder_.Path("root/a.zarr/density"));
  fs::create_directories(folder_.Path("root/pictures"));
  for (const char* name : {"root", ".", "root/a.zarr", "root/a.zarr/density"}) {
    options.folders.export_root = folder_.Path(name);
    EXPECT_THAT(JobRunner::Open(options).status(),
                FailsWith(absl::StatusCode::kFailedPrecondition, "--export-root"))
        << name;
  }
  options.folders.export_root = folder_.Path("root/pictures");
  EXPECT_THAT(JobRunner::Open(options).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "another server"));
}

}  // namespace
}  // namespace fovea::jobs
