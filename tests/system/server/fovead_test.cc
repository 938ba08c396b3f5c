// The real server program: how it starts, what it prints, how it stops.

#include <filesystem>
#include <fstream>
#include <future>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <signal.h>

#include "fovea/v1/render.grpc.pb.h"
#include "service/client/client.h"
#include "tests/support/status_matchers.h"
#include "tests/system/server/fovead_process.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::Fovead;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class FoveadTest : public ::testing::Test {
 protected:
  static constexpr char kGreeting[] = "fovead listening on grpc ";

  void MakeRoot() {
    std::filesystem::create_directories(Root());
    ASSERT_OK(store::testing::MakeStore(Root() + "/plume.zarr",
                                        store::testing::MakeInfo({24, 20, 16}, 16), 4));
  }
  [[nodiscard]] std::string Root() const { return folder_.Path("root"); }
  [[nodiscard]] std::string Log() const { return folder_.Path("log"); }

  /// Starts one on a free port and waits for its first line.
  std::unique_ptr<Fovead> StartServer(std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {Root(), "--listen", "127.0.0.1:0"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    auto fovead = std::make_unique<Fovead>(arguments, Log());
    const std::string line = fovead->ReadLine();
    EXPECT_THAT(line, StartsWith(kGreeting));
    address_ = line.substr(std::min(line.size(), sizeof(kGreeting) - 1));
    return fovead;
  }

  store::testing::TemporaryFolder folder_;
  std::string address_;
};

TEST_F(FoveadTest, ServesAndStopsOnSigterm) {
  MakeRoot();
  const auto fovead = StartServer();
  ASSERT_OK_AND_ASSIGN(const auto client, client::Client::Connect(address_));
  ASSERT_OK_AND_ASSIGN(const auto datasets, client->ListDatasets());
  ASSERT_EQ(datasets.size(), 1U);
  EXPECT_EQ(datasets[0].name, "plume");
  frames::FrameSpec spec;
  spec.width_px = 32;
  spec.height_px = 24;
  ASSERT_OK_AND_ASSIGN(const frames::Frame frame, client->RenderFrame("plume", 1, spec));
  EXPECT_EQ(frame.width_px, 32);
  fovead->Signal(SIGTERM);
  EXPECT_EQ(fovead->Wait(), 0);
  EXPECT_THAT(fovead->Log(), HasSubstr("0 calls cut short"));
  EXPECT_THAT(client->ListDatasets(), FailsWith(absl::StatusCode::kUnavailable, "fovea serve"));
}

TEST_F(FoveadTest, ARunningStreamIsDrained) {
  MakeRoot();
  const auto fovead = StartServer();
  ASSERT_OK_AND_ASSIGN(const auto client, client::Client::Connect(address_));
  ASSERT_OK_AND_ASSIGN(const auto other, client::Client::Connect(address_));
  client::SequenceRequest request;
  request.dataset = "plume";
  request.window = 1;
  request.spec.width_px = 32;
  request.spec.height_px = 32;
  int frames = 0;
  EXPECT_OK(client->RenderSequence(request, [&](const frames::Frame&) {
    if (++frames == 1) {
      fovead->Signal(SIGTERM);
      while (other->ListDatasets().ok()) {  // until it refuses
      }
    }
    return true;
  }));
  EXPECT_EQ(frames, 4);
  EXPECT_EQ(fovead->Wait(), 0);
  EXPECT_THAT(fovead->Log(), HasSubstr("0 calls cut short"));
}

TEST_F(FoveadTest, ADrainHasALimitAndASecondSignalNoPatience) {
  MakeRoot();
  // A stream whose client does not acknowledge would go on for ever.
  const auto stuck = [](const std::string& address, grpc::ClientContext* context) {
    const auto stub =
        v1::Render::NewStub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
    v1::RenderSequenceRequest request;
    request.set_dataset("plume");
    request.set_window(1);
    request.set_stream_id("0123456789abcdef");
    auto reader = stub->RenderSequence(context, request);
    v1::Frame frame;
    EXPECT_TRUE(reader->Read(&frame));
    return reader;
  };
  {
    const auto fovead = StartServer({"--drain-seconds", "0"});
    grpc::ClientContext context;
    const auto reader = stuck(address_, &context);
    fovead->Signal(SIGINT);
    EXPECT_EQ(fovead->Wait(), 0);
    EXPECT_THAT(fovead->Log(), HasSubstr("1 calls cut short"));
    EXPECT_FALSE(reader->Finish().ok());
  }
  const auto fovead = StartServer({"--drain-seconds", "3600"});
  grpc::ClientContext context;
  const auto reader = stuck(address_, &context);
  ASSERT_OK_AND_ASSIGN(const auto client, client::Client::Connect(address_));
  fovead->Signal(SIGTERM);
  while (client->ListDatasets().ok()) {  // until it refuses: the first signal was taken
  }
  fovead->Signal(SIGTERM);
  EXPECT_EQ(fovead->Wait(), 1);
  EXPECT_THAT(fovead->Log(), HasSubstr("second signal"));
  EXPECT_FALSE(reader->Finish().ok());
}

TEST_F(FoveadTest, SaysWhatIsWrong) {
  const auto run = [&](std::vector<std::string> arguments, int exit_status) {
    Fovead fovead(std::move(arguments), Log());
    EXPECT_EQ(fovead.ReadLine(), "");
    EXPECT_EQ(fovead.Wait(), exit_status);
    return fovead.Log();
  };
  EXPECT_THAT(run({folder_.Path("none")}, 1), HasSubstr("No such file or directory"));
  EXPECT_THAT(run({}, 2), HasSubstr("ROOT is required"));
  EXPECT_THAT(run({folder_.Path(""), "--threads", "-1"}, 2), HasSubstr("--threads"));
  EXPECT_THAT(run({folder_.Path(""), "--listen", "0.0.0.0:0"}, 2),
              HasSubstr("--insecure-plaintext"));
  EXPECT_THAT(run({folder_.Path(""), "--listen", "somewhere"}, 2), HasSubstr("HOST:PORT"));
}

TEST_F(FoveadTest, HelpTeaches) {
  Fovead fovead({"--help"}, Log());
  const std::string help = fovead.ReadAll();
  EXPECT_EQ(fovead.Wait(), 0);
  EXPECT_THAT(help, HasSubstr("--listen"));
  EXPECT_THAT(help, HasSubstr("--insecure-plaintext"));
}

}  // namespace
}  // namespace fovea
