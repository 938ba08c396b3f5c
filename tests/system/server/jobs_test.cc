// Jobs of the real server, which is killed while they run.

#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <random>
#include <string>

#include <grpcpp/grpcpp.h>

#include "fovea/v1/ingest.grpc.pb.h"
#include "fovea/v1/jobs.grpc.pb.h"
#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/system/server/fovead_process.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::Fovead;

class FoveadJobsTest : public ::testing::Test {
 protected:
  static constexpr int kSteps = 24;  // enough to be stopped in the middle
  static constexpr char kRaw[] = "128x128x128:uint8";

  void SetUp() override {
    for (const char* name : {"root", "in", "out"}) {
      fs::create_directories(folder_.Path(name));
    }
    std::mt19937 random(1);
    std::string voxels(128 * 128 * 128, '\0');
    for (int step = 0; step < kSteps; ++step) {
      for (char& voxel : voxels) {
        voxel = static_cast<char>(random());
      }
      std::ofstream(folder_.Path(fmt::format("in/s_{:02}.raw", step)), std::ios::binary) << voxels;
    }
  }
  void Start() {
    server_.reset();
    server_ = std::make_unique<Fovead>(
        std::vector<std::string>{folder_.Path("root"), "--listen", "127.0.0.1:0", "--allow-ingest",
                                 "--state", folder_.Path("state"), "--ingest-root",
                                 folder_.Path("in"), "--export-root", folder_.Path("out")},
        folder_.Path("log"));
    const std::string line = server_->ReadLine();
    ASSERT_NE(line, "") << server_->Log();
    channel_ =
        grpc::CreateChannel(line.substr(line.rfind(' ') + 1), grpc::InsecureChannelCredentials());
    jobs_ = v1::Jobs::NewStub(channel_);
  }
  std::string Ingest() {
    v1::IngestFilesRequest request;
    request.set_dataset("made");
    request.add_files("s_##.raw");
    request.set_raw(kRaw);
    grpc::ClientContext context;
    v1::Job job;
    EXPECT_TRUE(v1::Ingest::NewStub(channel_)->IngestFiles(&context, request, &job).ok());
    return job.id();
  }
  /// The first message of a watch for which this holds, or the last one.
  v1::Job Until(const std::string& id, const std::function<bool(const v1::Job&)>& condition) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    v1::WatchJobRequest request;
    request.set_id(id);
    const auto reader = jobs_->WatchJob(&context, request);
    v1::Job job;
    while (reader->Read(&job) && !condition(job)) {
    }
    context.TryCancel();
    static_cast<void>(reader->Finish());
    return job;
  }
  static std::string Bytes(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void ExpectAsPlainIngest() {
    ingest::IngestOptions options;
    options.inputs = {folder_.Path("in/s_##.raw")};
    options.output = folder_.Path("plain.zarr");
    options.raw = *ingest::ParseRawFormat(kRaw);
    ASSERT_OK(ingest::Ingest(options).status());
    const auto files = store::testing::FilesBelow(folder_.Path("root/made.zarr"));
    const auto plain = store::testing::FilesBelow(options.output);
    ASSERT_EQ(files.size(), plain.size());
    for (size_t i = 0; i < files.size(); ++i) {
      EXPECT_TRUE(Bytes(files[i]) == Bytes(plain[i])) << files[i];
    }
  }

  store::testing::TemporaryFolder folder_;
  std::unique_ptr<Fovead> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::Jobs::Stub> jobs_;
};

TEST_F(FoveadJobsTest, KilledAtAnyMomentAnIngestIsWholeInTheEnd) {
  Start();
  const std::string id = Ingest();
  for (const uint64_t done : {0, 1, 4}) {
    const v1::Job job = Until(id, [&](const v1::Job& now) {
      return now.state() != v1::Job::QUEUED && now.done() >= done;
    });
    EXPECT_GE(job.done(), done);
    server_->Signal(SIGKILL);
    Start();
  }
  const v1::Job job = Until(id, [](const v1::Job&) { return false; });
  EXPECT_EQ(job.state(), v1::Job::DONE) << job.message();
  EXPECT_EQ(job.done(), kSteps);
  ExpectAsPlainIngest();
}

TEST_F(FoveadJobsTest, SigtermStopsAJobCleanlyAndItGoesOn) {
  Start();
  const std::string id = Ingest();
  Until(id, [](const v1::Job& now) { return now.done() >= 1; });
  server_->Signal(SIGTERM);
  EXPECT_EQ(server_->Wait(), 0);
  EXPECT_NE(server_->Log().find("goes on at the next start"), std::string::npos) << server_->Log();
  Start();
  EXPECT_EQ(Until(id, [](const v1::Job&) { return false; }).state(), v1::Job::DONE);
  ExpectAsPlainIngest();
}

}  // namespace
}  // namespace fovea
