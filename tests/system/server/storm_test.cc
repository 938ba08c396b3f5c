// Streams that are cancelled at random moments, and clients that are killed with streams open: the
// server must be afterwards what it was before.
//   server_storm_test [STREAMS [KILLS [FOVEAD_PROGRAM]]]
// FOVEAD_PROGRAM may be of another build (preset asan, say): it must end with 0, which it does not
// if it leaked.

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <httplib.h>
#include <signal.h>
#include <spawn.h>

#include "tests/support/status_matchers.h"
#include "tests/system/server/fovead_process.h"
#include "tests/unit/engine/store/store_test_util.h"
#include "tests/unit/service/server/good_requests.h"
#include "tests/unit/service/server/raw_call.h"

namespace fovea::server {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

int streams = 300;
int kills = 30;
constexpr char kProgram[] = FOVEA_BINARY_DIR "/bin/fovead";
std::string program = kProgram;
// A sanitizer keeps what was freed.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kCountsMemory = false;
#else
constexpr bool kCountsMemory = true;
#endif

constexpr int kThreads = 8;

std::shared_ptr<grpc::Channel> Connect(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetMaxReceiveMessageSize(-1);
  return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
}

/// Good calls of every method that makes no job.
std::vector<RawCall> Calls() {
  std::vector<RawCall> calls;
  for (const GoodRequest& good : GoodRequests()) {
    RawCall& call = calls.emplace_back();
    call.method = good.Path();
    call.most_replies = SIZE_MAX;
    for (const auto& message : good.messages) {
      call.messages.push_back(message->SerializeAsString());
    }
    if (good.method->name() == "IngestFiles" || good.method->name() == "CreateExport") {
      calls.pop_back();
    } else if (good.method->client_streaming()) {
      calls.push_back(calls.back());
      calls.back().half_close = false;
      if (good.method->name() == "Explore") {
        calls.back().messages.resize(40, calls.back().messages.back());
      }
    }
  }
  return calls;
}

/// Opens streams and reads them until it is killed.
int RunClient(const std::string& address, unsigned seed) {
  const auto channel = Connect(address);
  std::vector<std::thread> threads;
  for (int i = 0; i < 6; ++i) {
    threads.emplace_back([&, i] {
      std::mt19937 random(seed + static_cast<unsigned>(i));
      std::vector<RawCall> calls = Calls();
      while (true) {
        RawCall& call = calls[random() % calls.size()];
        call.half_close = random() % 2 == 0;
        (void)Send(channel, call);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  return 0;
}

/// Opens so many streams, and cancels each at a random moment.
int RunCanceller(const std::string& address, unsigned seed, int count) {
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      std::mt19937 random(seed + static_cast<unsigned>(t));
      std::vector<RawCall> calls = Calls();
      auto channel = Connect(address);
      for (int i = t; i < count; i += kThreads) {
        RawCall& call = calls[random() % calls.size()];
        // Many in the first moments, few late.
        const double ms = std::exponential_distribution<double>(0.3)(random);
        call.cancel_after = microseconds(static_cast<int64_t>(1000 * ms));
        (void)Send(channel, call);
        if (random() % 64 == 0) {
          channel = Connect(address);
        }
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  return 0;
}

/// This program with other arguments. gRPC's clients live in processes that end: its library keeps
/// connections of channels that are gone for a while.
pid_t Spawn(std::vector<std::string> words) {
  words.insert(words.begin(), "/proc/self/exe");
  std::vector<char*> argv;
  for (std::string& word : words) {
    argv.push_back(word.data());
  }
  argv.push_back(nullptr);
  pid_t pid = -1;
  EXPECT_EQ(posix_spawn(&pid, "/proc/self/exe", nullptr, nullptr, argv.data(), environ), 0);
  return pid;
}

class StormTest : public ::testing::Test {
 protected:
  static constexpr char kGreeting[] = "fovead listening on grpc ";

  void SetUp() override {
    const std::string root = folder_.Path("root");
    std::filesystem::create_directories(root);
    const store::DatasetInfo info = store::testing::MakeInfo({40, 36, 30}, 16);
    ASSERT_OK(store::testing::MakeStore(root + "/plume.zarr", info, 5));
    // A port of our own choice, as only that of gRPC is printed.
    admin_ = fmt::format("127.0.0.1:{}", 20'000 + getpid() % 20'000);
    fovead_ = std::make_unique<testing::Fovead>(
        std::vector<std::string>{root, "--listen", "127.0.0.1:0", "--admin", admin_,
                                 "--allow-ingest", "--state", folder_.Path("state"), "--log-level",
                                 "warn", "--memory-limit", "1GiB"},
        folder_.Path("log"), program);
    const std::string line = fovead_->ReadLine();
    ASSERT_THAT(line, ::testing::StartsWith(kGreeting));
    address_ = line.substr(sizeof(kGreeting) - 1);
  }

  /// The samples of /metrics.
  [[nodiscard]] std::map<std::string, double> Scrape() const {
    std::map<std::string, double> samples;
    const auto reply = httplib::Client("http://" + admin_).Get("/metrics");
    EXPECT_TRUE(reply && reply->status == 200);
    std::istringstream lines(reply ? reply->body : "");
    for (std::string line; std::getline(lines, line);) {
      if (!line.starts_with('#')) {
        samples[line.substr(0, line.rfind(' '))] = std::stod(line.substr(line.rfind(' ') + 1));
      }
    }
    return samples;
  }

  /// What is under way or held for calls, by the gauges; empty when nothing is.
  [[nodiscard]] std::string Busy() const {
    std::string busy;
    for (const auto& [name, value] : Scrape()) {
      for (const char* gauge :
           {"fovea_requests_running", "fovea_queue_waiting", "fovea_queue_running",
            "fovea_memory_used_bytes", "fovea_connections_open"}) {
        busy += name.starts_with(gauge) && value != 0 ? fmt::format("{} {}\n", name, value) : "";
      }
    }
    return busy;
  }
  void AwaitIdle() const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    std::string busy = Busy();
    while (!busy.empty() && std::chrono::steady_clock::now() < end) {
      std::this_thread::sleep_for(milliseconds(20));
      busy = Busy();
    }
    EXPECT_EQ(busy, "");
  }
  [[nodiscard]] double ResidentMiB() const {
    return Scrape().at("process_resident_memory_bytes") / (1 << 20);
  }

  void CancelStreams(int count, unsigned seed) const {
    int status = -1;
    waitpid(Spawn({"--cancel", address_, std::to_string(seed), std::to_string(count)}), &status, 0);
    EXPECT_EQ(status, 0);
  }

  void KillClients(int count, unsigned seed) const {
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&, t] {
        std::mt19937 random(seed + static_cast<unsigned>(t));
        for (int i = t; i < count; i += 4) {
          const pid_t pid = Spawn({"--client", address_, std::to_string(random())});
          std::this_thread::sleep_for(milliseconds(20 + random() % 200));
          kill(pid, SIGKILL);
          waitpid(pid, nullptr, 0);
        }
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
  }

  store::testing::TemporaryFolder folder_;
  std::string address_, admin_;
  std::unique_ptr<testing::Fovead> fovead_;
};

TEST_F(StormTest, NothingIsLeftOfWhatEndedAtARandomMoment) {
  CancelStreams(streams / 4, 1);
  AwaitIdle();
  const double before = ResidentMiB();
  const double files = Scrape().at("process_open_fds");
  for (unsigned part = 2; part <= 4; ++part) {
    CancelStreams(streams / 4, part * 100);
    AwaitIdle();
    fmt::print("{} streams cancelled: {:.1f} MiB resident\n",
               part * static_cast<unsigned>(streams) / 4, ResidentMiB());
  }
  KillClients(kills, 7);
  AwaitIdle();
  const double after = ResidentMiB();
  fmt::print("{} clients killed: {:.1f} MiB resident\n", kills, after);
  std::map<std::string, double> ends;  // how calls ended, by code
  for (const auto& [name, value] : Scrape()) {
    if (name.starts_with("fovea_requests_total{code=")) {
      ends[name.substr(27, name.find('"', 27) - 27)] += value;
    }
  }
  for (const auto& [code, calls] : ends) {
    fmt::print("{} calls {}\n", calls, code);
  }
  EXPECT_GT(ends["CANCELLED"], streams / 8);
  EXPECT_LE(Scrape().at("process_open_fds"), files + 2);
  if (kCountsMemory && program == kProgram) {
    EXPECT_LE(after, before + 48);
  }
  fovead_->Signal(SIGTERM);
  EXPECT_EQ(fovead_->Wait(), 0) << fovead_->Log();
  EXPECT_THAT(fovead_->Log(), ::testing::Not(::testing::HasSubstr("Sanitizer")));
}

}  // namespace
}  // namespace fovea::server

int main(int argc, char** argv) {
  if (argc == 4 && std::string(argv[1]) == "--client") {
    return fovea::server::RunClient(argv[2], static_cast<unsigned>(std::stoul(argv[3])));
  }
  if (argc == 5 && std::string(argv[1]) == "--cancel") {
    return fovea::server::RunCanceller(argv[2], static_cast<unsigned>(std::stoul(argv[3])),
                                       std::stoi(argv[4]));
  }
  ::testing::InitGoogleMock(&argc, argv);
  fovea::server::streams = argc > 1 ? std::stoi(argv[1]) : fovea::server::streams;
  fovea::server::kills = argc > 2 ? std::stoi(argv[2]) : fovea::server::kills;
  fovea::server::program = argc > 3 ? argv[3] : fovea::server::program;
  return RUN_ALL_TESTS();
}
