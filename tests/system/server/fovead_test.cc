// The real server program: how it starts, what it prints, how it stops.

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <future>
#include <sstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <signal.h>
#include <spawn.h>

#include "fovea/v1/render.grpc.pb.h"
#include "service/client/client.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

/// A fovead; killed, if it still runs, when this goes.
class Fovead {
 public:
  Fovead(std::vector<std::string> arguments, std::string log) : log_(std::move(log)) {
    int out[2];
    EXPECT_EQ(pipe2(out, O_CLOEXEC), 0);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log_.c_str(),
                                     O_CREAT | O_WRONLY | O_TRUNC, 0600);
    const std::string program = FOVEA_BINARY_DIR "/bin/fovead";
    arguments.insert(arguments.begin(), program);
    std::vector<char*> argv;
    for (std::string& argument : arguments) {
      argv.push_back(argument.data());
    }
    argv.push_back(nullptr);
    EXPECT_EQ(posix_spawn(&pid_, program.c_str(), &actions, nullptr, argv.data(), environ), 0);
    posix_spawn_file_actions_destroy(&actions);
    close(out[1]);
    stdout_ = fdopen(out[0], "r");
  }
  ~Fovead() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      Wait();
    }
    fclose(stdout_);
  }

  /// The next line of stdout, without its end; empty at the end.
  std::string ReadLine() {
    char line[256] = "";
    if (fgets(line, sizeof(line), stdout_) == nullptr) {
      return "";
    }
    std::string text(line);
    text.pop_back();
    return text;
  }
  /// All of stdout that is left.
  std::string ReadAll() {
    std::string text;
    char block[4096];
    for (size_t size = 0; (size = fread(block, 1, sizeof(block), stdout_)) > 0;) {
      text.append(block, size);
    }
    return text;
  }
  void Signal(int signal) const { kill(pid_, signal); }
  /// Waits for the end; the exit status, or -1 for a signal.
  int Wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  [[nodiscard]] std::string Log() const {
    std::stringstream text;
    text << std::ifstream(log_).rdbuf();
    return text.str();
  }

 private:
  const std::string log_;
  pid_t pid_ = -1;
  FILE* stdout_ = nullptr;
};

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
