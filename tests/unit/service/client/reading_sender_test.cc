// Readings sent through the client to a server in this process.

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "service/access/token_file.h"
#include "service/client/client.h"
#include "service/server/server.h"
#include "service/wire/readings.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::client {
namespace {

using ::fovea::testing::FailsWith;

class ReadingSenderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(folder_.Path("root"));
    StartServer("127.0.0.1:0");
    ASSERT_OK_AND_ASSIGN(client_, Client::Connect(server_->address()));
  }
  /// From now on calls are of a token that may send so many bytes a second.
  void SetBytesInPerSecond(double bytes) {
    access::Token token;
    token.name = "lab";
    token.digest = access::DigestOf("secret");
    token.right = access::Right::kWrite;
    token.quotas.bytes_in_per_second = bytes;
    tokens_ = folder_.Path("tokens.json");
    ASSERT_OK(access::WriteTokenFile(tokens_, {token}));
    std::ofstream(folder_.Path("lab.token")) << "secret";
    server_.reset();
    StartServer("127.0.0.1:0");
    ASSERT_OK_AND_ASSIGN(
        client_, Client::Connect(server_->address(), {.token_file = folder_.Path("lab.token")}));
  }
  void StartServer(const std::string& address, bool allow_ingest = true) {
    server::ServerOptions options;
    options.root = folder_.Path("root");
    options.listen = address;
    options.allow_ingest = allow_ingest;
    options.tokens = tokens_;
    auto server = server::Server::Start(options);
    ASSERT_OK(server.status());
    server_ = *std::move(server);
  }
  static ReadingsSpec Spec() {
    ReadingsSpec spec;
    spec.dataset = "live";
    spec.fields = {"a", "b"};
    spec.steps.window_s = 1;
    spec.grid.emplace();
    spec.grid->hierarchy = *Hierarchy::Make({16, 16, 16});
    return spec;
  }
  /// `count` readings of second `step`, of the values step + 1 and -step.
  static Status SendStep(ReadingSender& sender, int step, int count = 20) {
    std::vector<sensors::Reading> readings;
    std::vector<float> values;
    for (int i = 0; i < count; ++i) {
      readings.push_back({i % 16 + 0.5, i / 16 % 16 + 0.5, 3, static_cast<double>(step), 0});
      values.push_back(static_cast<float>(step + 1));
      values.push_back(static_cast<float>(-step));
    }
    return sender.Send(readings, values);
  }
  void ExpectSteps(int steps) {
    ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(folder_.Path("root/live.zarr")));
    ASSERT_EQ(dataset->info().committed_steps, steps);
    for (int step = 0; step < steps; ++step) {
      ASSERT_OK_AND_ASSIGN(const FieldStats a, dataset->Stats(step, "a"));
      ASSERT_OK_AND_ASSIGN(const FieldStats b, dataset->Stats(step, "b"));
      EXPECT_EQ(a.minimum, step + 1);
      EXPECT_EQ(a.maximum, step + 1);
      EXPECT_EQ(b.minimum, -step);
    }
  }

  store::testing::TemporaryFolder folder_;
  std::string tokens_;  // of the server; empty: it asks for none
  std::unique_ptr<server::Server> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(ReadingSenderTest, SendsAndWaitsUntilAllIsSafe) {
  ASSERT_OK_AND_ASSIGN(const auto sender, client_->SendReadings(Spec()));
  for (int step = 0; step < 3; ++step) {
    ASSERT_OK(SendStep(*sender, step));
  }
  ASSERT_OK(sender->Finish());
  const SendingReport report = sender->report();
  EXPECT_EQ(report.batches, 4U);  // the last one is empty
  EXPECT_EQ(report.acknowledged, 4U);
  EXPECT_EQ(report.committed_steps, 3);
  EXPECT_EQ(report.counts.used, 60);
  EXPECT_EQ(report.resumed, 0);
  ExpectSteps(3);
}

TEST_F(ReadingSenderTest, ManyReadingsAreCutIntoMessages) {
  ASSERT_OK_AND_ASSIGN(const auto sender, client_->SendReadings(Spec()));
  const auto most = static_cast<int>(wire::ReadingsOfOneMessage(2));
  ASSERT_OK(SendStep(*sender, 0, 2 * most + 1));
  ASSERT_OK(sender->Finish());
  EXPECT_EQ(sender->report().batches, 4U);
  EXPECT_EQ(sender->report().counts.read, 2 * most + 1);
}

TEST_F(ReadingSenderTest, GoesOnWhenTheServerWasAway) {
  ASSERT_OK_AND_ASSIGN(const auto sender, client_->SendReadings(Spec()));
  ASSERT_OK(SendStep(*sender, 0));
  ASSERT_OK(SendStep(*sender, 1));
  const std::string address = server_->address();
  server_.reset();  // step 1 is open, and dropped
  std::thread restart([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    StartServer(address);
  });
  Status status = absl::OkStatus();
  for (int step = 2; step < 6 && status.ok(); ++step) {
    status = SendStep(*sender, step);
  }
  restart.join();
  ASSERT_OK(status);
  ASSERT_OK(sender->Finish());
  EXPECT_EQ(sender->report().resumed, 1);
  EXPECT_EQ(sender->report().acknowledged, sender->report().batches);
  ExpectSteps(6);
}

TEST_F(ReadingSenderTest, WatchersAndFollowersOfTheClientSeeWhatIsSent) {
  ASSERT_OK_AND_ASSIGN(const auto sender, client_->SendReadings(Spec()));
  ASSERT_OK(SendStep(*sender, 0));
  ASSERT_OK(SendStep(*sender, 1));
  std::vector<int64_t> steps;
  bool sent = false;
  ASSERT_OK(client_->WatchDataset(
      {"live", 0, false},
      [&](const DatasetEvent& event) {
        EXPECT_TRUE(event.present);
        for (const DatasetEvent::Step& step : event.steps) {
          steps.push_back(step.step);
          EXPECT_EQ(step.time_ns, step.step * 1'000'000'000);
          EXPECT_EQ(step.frame_number, step.step);
        }
        if (!sent && !steps.empty()) {
          sent = true;
          EXPECT_OK(SendStep(*sender, 2));
          EXPECT_OK(SendStep(*sender, 3));
        }
        return steps.size() < 3;
      },
      nullptr));
  EXPECT_EQ(steps, (std::vector<int64_t>{0, 1, 2}));
  SequenceRequest follow;
  follow.dataset = "live";
  follow.follow = true;
  follow.spec.width_px = 16;
  follow.spec.height_px = 16;
  std::vector<int64_t> seen;
  ASSERT_OK(client_->RenderSequence(follow, [&](const frames::Frame& frame) {
    seen.push_back(frame.step);
    if (seen.size() == 1) {
      EXPECT_OK(SendStep(*sender, 5));  // closes 3
    }
    return seen.size() < 2;
  }));
  EXPECT_EQ(seen, (std::vector<int64_t>{2, 3}));
  follow.last = 3;
  EXPECT_THAT(client_->RenderSequence(follow, nullptr),
              FailsWith(absl::StatusCode::kInvalidArgument, "has no end"));
  ASSERT_OK(sender->Finish());
}

TEST_F(ReadingSenderTest, AWatchCanBeStoppedWhileNothingHappens) {
  int turns = 0;
  EXPECT_OK(client_->WatchDataset(
      {"nothing", 0, true},
      [](const DatasetEvent& event) {
        EXPECT_FALSE(event.present);
        return true;
      },
      [&] { return ++turns < 2; }));
  EXPECT_THAT(client_->WatchDataset({"nothing", 0, false}, nullptr, nullptr),
              FailsWith(absl::StatusCode::kNotFound, "nothing"));
}

TEST_F(ReadingSenderTest, SaysWhatTheServerSays) {
  ReadingsSpec wrong = Spec();
  wrong.dataset = "../up";
  EXPECT_THAT(client_->SendReadings(wrong),
              FailsWith(absl::StatusCode::kInvalidArgument, "header.dataset"));
  ASSERT_OK_AND_ASSIGN(const auto first, client_->SendReadings(Spec()));
  EXPECT_THAT(client_->SendReadings(Spec()),
              FailsWith(absl::StatusCode::kFailedPrecondition, "being written"));
  const float value = 1;
  const sensors::Reading reading{1, 1, 1, 0, 0};
  EXPECT_THAT(first->Send({&reading, 1}, {&value, 1}),
              FailsWith(absl::StatusCode::kInvalidArgument, "1 values for 1 readings of 2"));
}

/// A step of several seconds' worth: nothing of it can be safe before its end.
TEST_F(ReadingSenderTest, AQuotaHoldsBackAndLosesNothing) {
  constexpr double kBytesPerSecond = 50'000;
  SetBytesInPerSecond(kBytesPerSecond);
  std::atomic<int> told = 0;
  ASSERT_OK_AND_ASSIGN(const auto sender, client_->SendReadings(Spec(), [&](const HeldBack& held) {
    EXPECT_GT(held.seconds, 0);
    ++told;
    return true;
  }));
  const auto begin = std::chrono::steady_clock::now();
  for (int part = 0; part < 4; ++part) {
    ASSERT_OK(SendStep(*sender, 0, 1000));  // 40 kB
  }
  ASSERT_OK(SendStep(*sender, 1));
  ASSERT_OK(sender->Finish());
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  EXPECT_GT(took.count(), 4 * 40'000 / kBytesPerSecond - 1);
  EXPECT_GE(told, 1);
  EXPECT_EQ(sender->report().resumed, 0);
  EXPECT_EQ(sender->report().acknowledged, sender->report().batches);
  ExpectSteps(2);
}

TEST_F(ReadingSenderTest, WhoIsHeldBackMayGiveUp) {
  SetBytesInPerSecond(1);  // the first message is half a minute's worth
  ASSERT_OK_AND_ASSIGN(const auto sender,
                       client_->SendReadings(Spec(), [](const HeldBack&) { return false; }));
  Status status = absl::OkStatus();
  for (int step = 0; step < 100 && status.ok(); ++step) {
    status = SendStep(*sender, step, 1000);
  }
  if (status.ok()) {  // all of it is under way, and must arrive
    status = sender->Finish();
  }
  EXPECT_TRUE(absl::IsCancelled(status)) << status;
}

TEST_F(ReadingSenderTest, AServerThatTakesNoneIsSaidAtOnce) {
  const std::string address = server_->address();
  server_.reset();
  StartServer(address, false);
  EXPECT_THAT(client_->SendReadings(Spec()),
              FailsWith(absl::StatusCode::kPermissionDenied, "--allow-ingest"));
}

}  // namespace
}  // namespace fovea::client
