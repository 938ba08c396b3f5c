#include "ingest/worker_client.h"

#include <sys/wait.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "engine/base/stopwatch.h"
#include "ingest/dense_field.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;

WorkerOptions Fake(double seconds) {
  WorkerOptions options;
  options.limits.seconds_per_file = seconds;
  options.program = FOVEA_BINARY_DIR "/bin/ingest_fake_worker";
  return options;
}

Status Scan(WorkerClient* client, const std::string& path) {
  return client->Call(path, Encode(ScanRequest{{path}, {}, false}), {},
                      [](const FrameView& frame) { return DecodeFileInfo(frame).status(); });
}

TEST(WorkerClientTest, OneWorkerServesManyFiles) {
  WorkerClient client(Fake(30));
  EXPECT_EQ(client.pid(), 0);
  ASSERT_OK(Scan(&client, "fine"));
  const pid_t first = client.pid();
  ASSERT_OK(Scan(&client, "fine"));
  EXPECT_EQ(client.pid(), first);
}

TEST(WorkerClientTest, ADeadWorkerIsReportedWithFileAndSignalAndReplaced) {
  WorkerClient client(Fake(30));
  EXPECT_THAT(Scan(&client, "crash"), FailsWith(absl::StatusCode::kDataLoss, "crash: "));
  EXPECT_THAT(Scan(&client, "crash"), FailsWith(absl::StatusCode::kDataLoss, "signal 6 (Aborted)"));
  EXPECT_THAT(Scan(&client, "killed"), FailsWith(absl::StatusCode::kDataLoss, "signal 9 (Killed)"));
  EXPECT_THAT(Scan(&client, "exits"), FailsWith(absl::StatusCode::kDataLoss, "exit status 3"));
  EXPECT_OK(Scan(&client, "fine"));
}

TEST(WorkerClientTest, TooMuchProcessorTimeNamesTheFlag) {
  WorkerOptions options = Fake(30);
  options.limits.cpu_seconds_per_file = 7;
  WorkerClient client(options);
  EXPECT_THAT(Scan(&client, "works"),
              FailsWith(absl::StatusCode::kDeadlineExceeded, "7 seconds of processor time"));
  EXPECT_THAT(Scan(&client, "works"),
              FailsWith(absl::StatusCode::kDeadlineExceeded, "--worker-cpu-seconds"));
}

TEST(WorkerClientTest, AWorkerIsReplacedForAFileThatItWasNotStartedWith) {
  const fovea::testing::TemporaryFolder folder;
  const std::string known = folder / "known";
  const std::string later = folder / "later";
  std::ofstream(known) << "1";
  std::ofstream(later) << "2";
  WorkerOptions options = Fake(30);
  options.files = {known};
  WorkerClient client(options);
  client.Allow({known});
  ASSERT_OK(Scan(&client, "fine"));
  const pid_t first = client.pid();
  client.Allow({known});
  ASSERT_OK(Scan(&client, "fine"));
  EXPECT_EQ(client.pid(), first);

  client.Allow({later});
  ASSERT_OK(Scan(&client, "fine"));
  const pid_t second = client.pid();
  EXPECT_NE(second, first);
  client.Allow({known, later});
  ASSERT_OK(Scan(&client, "fine"));
  EXPECT_EQ(client.pid(), second);

  std::filesystem::rename(later, known);  // another file of a name that it knows
  client.Allow({known});
  ASSERT_OK(Scan(&client, "fine"));
  EXPECT_NE(client.pid(), second);
}

TEST(WorkerClientTest, TheRealWorkerReadsNothingButWhatWasAllowed) {
  WorkerOptions options;
  options.openvdb = true;
  options.files = {FOVEA_SOURCE_DIR "/tests/data/plume/plume_0001.vdb"};
  WorkerClient client(options);
  const auto hello = client.Greet();
  ASSERT_OK(hello);
  if (hello->landlock_abi == 0) {
    GTEST_SKIP() << "this kernel has no Landlock";
  }
  const std::string other = FOVEA_SOURCE_DIR "/tests/data/plume/plume_0005.vdb";
  const auto ignore = [](const FrameView&) { return absl::OkStatus(); };
  const Frame request = Encode(ScanRequest{{other}, {}, false});
  EXPECT_THAT(client.Call(other, request, {}, ignore),
              FailsWith(absl::StatusCode::kNotFound, "Permission denied"));
  client.Allow({other});
  EXPECT_OK(client.Call(other, request, {}, ignore));
}

TEST(WorkerClientTest, AWorkerThatDiesBetweenFilesIsReplacedUnnoticed) {
  WorkerClient client(Fake(30));
  ASSERT_OK(Scan(&client, "fine"));
  const pid_t first = client.pid();
  ::kill(first, SIGKILL);
  siginfo_t about;  // wait for its end, but leave it to the client to take note of
  ASSERT_EQ(::waitid(P_PID, static_cast<id_t>(first), &about, WEXITED | WNOWAIT), 0);
  EXPECT_OK(Scan(&client, "fine"));
  EXPECT_NE(client.pid(), first);
}

TEST(WorkerClientTest, TheDeadlineEndsAWorkerThatHangs) {
  WorkerClient client(Fake(0.2));
  const Stopwatch watch;
  EXPECT_THAT(Scan(&client, "hangs"), FailsWith(absl::StatusCode::kDeadlineExceeded, "hangs: "));
  EXPECT_LT(watch.ElapsedMs(), 3000);
  EXPECT_EQ(client.pid(), 0);
}

TEST(WorkerClientTest, TheDeadlineEndsAWorkerThatNeverStopsTalking) {
  WorkerClient client(Fake(0.2));
  EXPECT_THAT(Scan(&client, "chatters"), FailsWith(absl::StatusCode::kDeadlineExceeded, ""));
}

TEST(WorkerClientTest, AWorkerThatHangsUpAndLivesOnIsKilled) {
  WorkerClient client(Fake(30));
  EXPECT_THAT(Scan(&client, "closes"), FailsWith(absl::StatusCode::kDataLoss, "signal 9"));
}

TEST(WorkerClientTest, NonsenseEndsTheWorker) {
  WorkerClient client(Fake(30));
  EXPECT_THAT(Scan(&client, "nonsense"), FailsWith(absl::StatusCode::kInternal, "nonsense: "));
  EXPECT_EQ(client.pid(), 0);
}

TEST(WorkerClientTest, AnErrorOfTheWorkerIsMadePrintableAndTheWorkerStays) {
  WorkerClient client(Fake(30));
  EXPECT_THAT(Scan(&client, "error"),
              FailsWith(absl::StatusCode::kNotFound, "error: what was ?[1m asked for"));
  EXPECT_NE(client.pid(), 0);
}

TEST(WorkerClientTest, AWorkerThatMisusesSlabsIsReported) {
  WorkerClient client(Fake(0.5));
  const auto read = [&](const std::string& path) {
    DenseField field({{0, 0, 0}, {8, 8, 1000000}}, 32, 1 << 20);
    const auto drop = [](const DenseSlices&) { return absl::OkStatus(); };
    return client.Call(
        path, Encode(ScanRequest{{path}, {}, false}), {},
        [&](const FrameView& frame) { return field.Consume(frame, client.slabs(), drop); });
  };
  EXPECT_THAT(read("slabs and out"), FailsWith(absl::StatusCode::kDataLoss, "signal 9"));
  EXPECT_THAT(read("slabs beyond"), FailsWith(absl::StatusCode::kInternal, "slab"));
  EXPECT_THAT(read("slabs forever"), FailsWith(absl::StatusCode::kDeadlineExceeded, ""));
  EXPECT_OK(Scan(&client, "fine"));
}

TEST(WorkerClientTest, InterruptEndsACallFromAnotherThread) {
  WorkerClient client(Fake(30));
  ASSERT_OK(Scan(&client, "fine"));
  std::thread interrupter([&] { client.Interrupt(); });
  const Stopwatch watch;
  // The kill comes before or during the call; either way it does not last to the deadline.
  const Status status = Scan(&client, "fine");
  interrupter.join();
  EXPECT_TRUE(status.ok() || absl::IsDataLoss(status)) << status;
  EXPECT_LT(watch.ElapsedMs(), 10000);
}

TEST(WorkerClientTest, AProgramThatIsNotThereIsNamed) {
  WorkerOptions options = Fake(30);
  options.program = "/nowhere/fovea-worker";
  WorkerClient client(options);
  EXPECT_THAT(Scan(&client, "x"),
              FailsWith(absl::StatusCode::kUnavailable, "/nowhere/fovea-worker"));
}

TEST(WorkerMemoryTest, FollowsWhatTheFilesDeclare) {
  WorkerOptions options;
  options.limits.memory_bytes = 123456789;
#ifdef FOVEA_SANITIZED
  EXPECT_EQ(WorkerMemoryBytes(options), 0);
#else
  EXPECT_EQ(WorkerMemoryBytes(options), 123456789);
  options.limits.memory_bytes.reset();
  EXPECT_EQ(WorkerMemoryBytes(options), 512 << 20);
  options.declared_bytes = 1 << 20;
  EXPECT_EQ(WorkerMemoryBytes(options), (512 << 20) + (3 << 20));
  const int64_t machine = [&] {
    options.declared_bytes = std::numeric_limits<int64_t>::max();  // a file may say anything
    return WorkerMemoryBytes(options);
  }();
  EXPECT_GE(machine, 512 << 20);
  EXPECT_LT(machine, int64_t{1} << 50);
#endif
}

}  // namespace
}  // namespace fovea::ingest
