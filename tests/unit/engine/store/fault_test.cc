#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>

#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>

#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/verify.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using std::chrono::steady_clock;
using testing::MakeInfo;
using testing::MakeStep;
using testing::StepData;
using testing::TemporaryFolder;

constexpr auto kExhausted = absl::StatusCode::kResourceExhausted;
constexpr Int3 kDims{40, 33, 50};  // as store_test_writer

void ExpectSound(const std::string& path, int64_t steps) {
  ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(path, 1));
  EXPECT_EQ(report.steps, steps);
  EXPECT_THAT(report.problems, ::testing::IsEmpty());
}

void ExpectStep(Dataset* dataset, int64_t step) {
  const StepData data = MakeStep(kDims, 8, static_cast<int>(step));
  MemorySource memory(data.coefficients);
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(step, "density", OnDamage::kFail));
  for (int level = 0; level < memory.hierarchy().finest(); ++level) {
    ASSERT_OK_AND_ASSIGN(const auto stored, testing::ReadLevel(source.get(), level));
    ASSERT_OK_AND_ASSIGN(const auto wanted, testing::ReadLevel(&memory, level));
    EXPECT_EQ(stored, wanted) << "step " << step << " level " << level;
  }
}

pid_t StartWriter(const std::string& path) {
  const std::string program = std::string(FOVEA_BINARY_DIR) + "/bin/store_test_writer";
  std::string argument = path;
  char* const arguments[] = {const_cast<char*>(program.c_str()), argument.data(), nullptr};
  pid_t child = -1;
  EXPECT_EQ(posix_spawn(&child, program.c_str(), nullptr, nullptr, arguments, environ), 0);
  return child;
}

/// What a reader beside the writer sees: nothing, or a store of which the newest committed step is
/// whole. Returns the committed steps, -1 if there is no store yet.
int64_t ReadBesideWriter(const std::string& path) {
  const auto dataset = Dataset::Open(path);
  if (!dataset.ok()) {
    EXPECT_TRUE(absl::IsNotFound(dataset.status()) || absl::IsFailedPrecondition(dataset.status()))
        << MessageOf(dataset.status());
    return -1;
  }
  const int64_t steps = (*dataset)->info().committed_steps;
  if (steps > 0) {
    ExpectStep(dataset->get(), steps - 1);
    const auto time_ns = (*dataset)->TimeNs(steps - 1);
    EXPECT_OK(time_ns);
    EXPECT_EQ(time_ns.value_or(-1), (steps - 1) * 1'000'000'000);
  }
  return steps;
}

/// Waits for the writer to get somewhere: to make the folder in the first rounds, to commit some
/// steps in the later ones. How far it gets after that, before it is killed, is chance.
void WaitForProgress(const std::string& path, int round, int64_t committed, unsigned some) {
  const auto deadline = steady_clock::now() + std::chrono::seconds(60);
  const auto there = [&] {
    return round < 5 ? fs::exists(path) : ReadBesideWriter(path) > committed + some % 2;
  };
  while (!there()) {
    ASSERT_LT(steady_clock::now(), deadline) << "the writer does not get on";
    std::this_thread::yield();
  }
}

TEST(StoreFaults, NoKillOfTheWriterDamagesACommittedStep) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  std::mt19937 random(20);
  int64_t committed = 0;
  for (int round = 0; round < 20; ++round) {
    const pid_t writer = StartWriter(path);
    WaitForProgress(path, round, committed, random());
    const auto moment = steady_clock::now() + std::chrono::microseconds(random() % 12000);
    while (steady_clock::now() < moment) {
      ReadBesideWriter(path);
    }
    ASSERT_EQ(::kill(writer, SIGKILL), 0);
    int status = 0;
    ASSERT_EQ(::waitpid(writer, &status, 0), writer);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the writer ended by itself";
    if (const int64_t steps = ReadBesideWriter(path); steps >= 0) {
      EXPECT_GE(steps, committed);
      ExpectSound(path, steps);
      committed = steps;
    }
  }
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(path));
  EXPECT_EQ(writer->info().committed_steps, committed);
  ASSERT_OK(testing::WriteSteps(writer.get(), 1));
  ExpectSound(path, committed + 1);
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
  for (int64_t step = 0; step <= committed; ++step) {
    ExpectStep(dataset.get(), step);
  }
}

/// While it lives, no file may grow past `bytes`: writing fails as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    old_handler_ = ::signal(SIGXFSZ, SIG_IGN);
    EXPECT_EQ(::getrlimit(RLIMIT_FSIZE, &old_limit_), 0);
    const rlimit limit{bytes, old_limit_.rlim_max};
    EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  }
  ~FileSizeLimit() {
    EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &old_limit_), 0);
    ::signal(SIGXFSZ, old_handler_);
  }

 private:
  rlimit old_limit_{};
  void (*old_handler_)(int) = nullptr;
};

size_t CountTemporaryFiles(const std::string& path) {
  const std::vector<std::string> files = testing::FilesBelow(path);
  return static_cast<size_t>(std::count_if(files.begin(), files.end(), [](const auto& file) {
    return IsTemporaryName(fs::path(file).filename().string());
  }));
}

TEST(StoreFaults, AWriteThatFailsLeavesTheStoreAsItWas) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create(path, MakeInfo(kDims, 8)));
  ASSERT_OK(testing::WriteSteps(writer.get(), 2));
  const StepData data = MakeStep(kDims, 8, 2);
  for (const rlim_t limit : {0, 100, 3000, 20000}) {
    const FileSizeLimit full(limit);
    EXPECT_THAT(writer->WriteField("density", data.coefficients, data.stats),
                FailsWith(kExhausted, path + "/density/"));
    EXPECT_EQ(CountTemporaryFiles(path), 0U);
  }
  for (const rlim_t limit : {0, 40, 300}) {  // in the small arrays; in a zarr.json
    ASSERT_OK(writer->WriteField("density", data.coefficients, data.stats));
    const FileSizeLimit full(limit);
    EXPECT_THAT(writer->Commit(2'000'000'000, 1), FailsWith(kExhausted, path));
    EXPECT_EQ(CountTemporaryFiles(path), 0U);
  }
  EXPECT_EQ(writer->info().committed_steps, 2);
  ExpectSound(path, 2);
  ASSERT_OK(testing::WriteSteps(writer.get(), 1));  // the same writer goes on
  ExpectSound(path, 3);
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
  ExpectStep(dataset.get(), 2);
}

TEST(StoreFaults, ACreationThatFailsCanBeRepeated) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  {
    const FileSizeLimit full(200);
    EXPECT_THAT(DatasetWriter::Create(path, MakeInfo(kDims, 8)), FailsWith(kExhausted, path));
  }
  EXPECT_OK(testing::MakeStore(path, MakeInfo(kDims, 8), 1));
  ExpectSound(path, 1);
}

/// In a mount namespace of its own, so that the mount goes with this process.
bool MountSmallDisk(const std::string& path, const std::string& options) {
  return ::unshare(CLONE_NEWNS) == 0 &&
         ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
         ::mount("tmpfs", path.c_str(), "tmpfs", 0, options.c_str()) == 0;
}

TEST(StoreFaults, AFullDiskLeavesTheStoreAsItWas) {
  TemporaryFolder folder;
  const std::string disk = folder.Path("disk");
  fs::create_directory(disk);
  if (!MountSmallDisk(disk, "size=4m")) {
    GTEST_SKIP() << "needs the right to mount a tmpfs: " << std::strerror(errno);
  }
  const std::string path = disk + "/a.zarr";
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create(path, MakeInfo(kDims, 8)));
  Status status;
  while (status.ok()) {
    status = testing::WriteSteps(writer.get(), 1);
  }
  EXPECT_THAT(status, FailsWith(kExhausted, path));
  const int64_t steps = writer->info().committed_steps;
  EXPECT_GT(steps, 0);
  EXPECT_EQ(CountTemporaryFiles(path), 0U);
  ExpectSound(path, steps);
  EXPECT_FALSE(testing::WriteSteps(writer.get(), 1).ok());
  ASSERT_EQ(::mount("tmpfs", disk.c_str(), "tmpfs", MS_REMOUNT, "size=8m"), 0);
  ASSERT_OK(testing::WriteSteps(writer.get(), 1));
  ExpectSound(path, steps + 1);
  ::umount(disk.c_str());
}

}  // namespace
}  // namespace fovea::store
