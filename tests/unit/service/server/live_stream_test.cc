// Streams of readings on real pools and real stores, with threads in gRPC's place: everything about
// them that a thread sanitizer can follow.

#include "service/server/live_stream.h"

#include <atomic>
#include <chrono>
#include <filesystem>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

v1::StreamReadingsRequest Header(const std::string& dataset) {
  v1::StreamReadingsRequest message;
  v1::ReadingsHeader& header = *message.mutable_header();
  header.set_dataset(dataset);
  header.set_step_seconds(1);
  header.mutable_lower();
  for (auto* vec : {header.mutable_upper(), header.mutable_voxel()}) {
    const double size = vec == &header.upper() ? 8 : 1;
    vec->set_x(size);
    vec->set_y(size);
    vec->set_z(size);
  }
  return message;
}

/// Readings of second `sequence`.
v1::StreamReadingsRequest Batch(uint64_t sequence, int readings = 2) {
  v1::StreamReadingsRequest message;
  v1::ReadingBatch& batch = *message.mutable_batch();
  batch.set_sequence(sequence);
  for (int i = 0; i < readings; ++i) {
    batch.add_time_ns(static_cast<int64_t>(sequence) * 1'000'000'000);
    batch.add_x(i % 8);
    batch.add_value(static_cast<float>(sequence));
  }
  return message;
}

/// A client on threads of its own: sends its messages as it is asked for them, and may go.
class FakePeer final : public ReadingsPeer {
 public:
  FakePeer(Services& services, WorkPool& network, std::vector<v1::StreamReadingsRequest> messages)
      : network_(network),
        messages_(std::move(messages)),
        stream_(std::make_shared<LiveStream>(services, *this)),
        caller_(*services.gate->Identify({})) {}

  /// Cancels instead of giving the message of this number.
  void set_cancel_at(size_t index) { cancel_at_ = index; }
  /// Cancels on another thread while it is asked for the first message.
  void set_cancel_in_read() { cancel_in_read_ = true; }
  void Start() { stream_->Start(absl::OkStatus(), caller_); }
  Status Wait() { return end_.get_future().get(); }
  [[nodiscard]] uint64_t acknowledged() const { return acknowledged_; }  // after Wait
  [[nodiscard]] size_t asked() const { return next_; }                   // messages, so far

  void Read() override {
    EXPECT_FALSE(reading_.exchange(true)) << "two reads at a time";
    if (cancel_in_read_) {
      std::thread([this] { stream_->OnCancel(); }).join();
      EXPECT_FALSE(ended_) << "gRPC may delete what is being called";
    }
    network_.SubmitAdmitted(0, [this, stream = stream_](int) {
      reading_ = false;
      const size_t index = next_++;
      if (index == cancel_at_) {
        stream->OnCancel();
        stream->OnReadsDone();  // as gRPC tells both
      } else if (index < messages_.size()) {
        stream->OnMessage(messages_[index]);
      } else {
        stream->OnReadsDone();
      }
    });
  }
  void Write(const v1::StreamReadingsResponse& response) override {
    EXPECT_FALSE(writing_.exchange(true)) << "two writes at a time";
    EXPECT_GE(response.acknowledged(), acknowledged_);
    EXPECT_LE(response.acknowledged(), next_.load());
    acknowledged_ = response.acknowledged();
    network_.SubmitAdmitted(0, [this, stream = stream_](int) {
      writing_ = false;
      stream->OnWriteDone(true);
    });
  }
  void Finish(const Status& status) override {
    ended_ = true;
    end_.set_value(status);  // throws if it comes twice
  }

 private:
  WorkPool& network_;
  const std::vector<v1::StreamReadingsRequest> messages_;
  size_t cancel_at_ = ~size_t{0};
  bool cancel_in_read_ = false;
  const std::shared_ptr<LiveStream> stream_;
  const std::shared_ptr<access::Caller> caller_;
  std::atomic<size_t> next_ = 0;
  std::atomic<bool> reading_ = false, writing_ = false, ended_ = false;
  uint64_t acknowledged_ = 0;
  std::promise<Status> end_;
};

class LiveStreamTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string root = folder_.Path("root");
    std::filesystem::create_directories(root);
    auto catalogue = Catalogue::Open(root, std::chrono::milliseconds(0));
    ASSERT_OK(catalogue.status());
    services_ = std::make_unique<Services>(
        *std::move(catalogue), *access::Gate::Open(""), int64_t{1} << 30,
        WorkPool::Limits{.name = "lookup queue", .flag = "", .threads = 2, .max_waiting = 100},
        WorkPool::Limits{.name = "render queue", .flag = "", .threads = 1, .max_waiting = 100},
        true);
    network_ = std::make_unique<WorkPool>(
        WorkPool::Limits{.name = "network", .flag = "", .threads = 3, .max_waiting = 100});
  }
  void TearDown() override {
    network_.reset();
    services_.reset();
  }
  std::unique_ptr<FakePeer> MakePeer(std::vector<v1::StreamReadingsRequest> messages) {
    return std::make_unique<FakePeer>(*services_, *network_, std::move(messages));
  }
  /// A header and batches 1 to `count`, of which the last one is the last.
  static std::vector<v1::StreamReadingsRequest> Messages(const std::string& dataset,
                                                         uint64_t count) {
    std::vector<v1::StreamReadingsRequest> messages = {Header(dataset)};
    for (uint64_t i = 1; i <= count; ++i) {
      messages.push_back(Batch(i));
    }
    messages.back().mutable_batch()->set_last(true);
    return messages;
  }
  int64_t StepsOf(const std::string& name) {
    const auto dataset = store::Dataset::Open(folder_.Path("root/" + name + ".zarr"));
    return dataset.ok() ? (*dataset)->info().committed_steps : 0;
  }

  store::testing::TemporaryFolder folder_;
  std::unique_ptr<Services> services_;
  std::unique_ptr<WorkPool> network_;
};

TEST_F(LiveStreamTest, DoesNotEndWhileItsClientIsAskedForAMessage) {
  const auto peer = MakePeer({});
  peer->set_cancel_in_read();
  peer->Start();
  EXPECT_TRUE(absl::IsCancelled(peer->Wait()));
}

TEST_F(LiveStreamTest, ManyStreamsAndClientsThatGo) {
  constexpr uint64_t kBatches = 5;
  std::vector<std::unique_ptr<FakePeer>> peers;
  for (size_t i = 0; i < 12; ++i) {
    peers.push_back(MakePeer(Messages("live" + std::to_string(i), kBatches)));
    if (i % 2 == 1) {
      peers.back()->set_cancel_at(i / 2);
    }
    peers.back()->Start();
  }
  for (size_t i = 0; i < peers.size(); ++i) {
    const Status status = peers[i]->Wait();
    const int64_t steps = StepsOf("live" + std::to_string(i));
    if (i % 2 == 0) {
      EXPECT_OK(status);
      EXPECT_EQ(peers[i]->acknowledged(), kBatches);
      EXPECT_EQ(steps, static_cast<int64_t>(kBatches));
    } else {
      EXPECT_TRUE(absl::IsCancelled(status)) << status;
      EXPECT_GE(steps, static_cast<int64_t>(peers[i]->acknowledged()));
      EXPECT_LT(steps, static_cast<int64_t>(kBatches));
    }
  }
  EXPECT_EQ(services_->live_streams, 0);
  EXPECT_EQ(services_->requests.used_bytes(), 0);
}

TEST_F(LiveStreamTest, OnlyOneOfManyWritesADataset) {
  std::vector<std::unique_ptr<FakePeer>> peers;
  for (int i = 0; i < 6; ++i) {
    peers.push_back(MakePeer(Messages("live", 3)));
    peers.back()->Start();
  }
  int done = 0;
  for (const auto& peer : peers) {
    const Status status = peer->Wait();
    done += status.ok() ? 1 : 0;
    EXPECT_TRUE(status.ok() || absl::IsFailedPrecondition(status)) << status;
  }
  EXPECT_GE(done, 1);
  EXPECT_EQ(StepsOf("live"), 3);
}

TEST_F(LiveStreamTest, NothingIsReadOnWhileTooMuchWaits) {
  std::promise<void> go;
  const auto gone = go.get_future().share();
  for (int i = 0; i < Services::kIngestThreads; ++i) {
    services_->ingests.SubmitAdmitted(0, [gone](int) { gone.wait(); });
  }
  constexpr uint64_t kBatches = 20;
  std::vector<v1::StreamReadingsRequest> messages = {Header("live")};
  for (uint64_t i = 1; i <= kBatches; ++i) {
    messages.push_back(Batch(i, 10'000));
  }
  messages.back().mutable_batch()->set_last(true);
  const auto bytes = static_cast<int64_t>(messages.back().ByteSizeLong());
  WorkPool network({.name = "network", .flag = "", .threads = 1, .max_waiting = 100});
  FakePeer peer(*services_, network, std::move(messages));
  peer.Start();
  const auto expected = static_cast<size_t>(2 + LiveStream::kMostWaitingBytes / bytes);
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (peer.asked() < expected && std::chrono::steady_clock::now() < limit) {
    std::this_thread::yield();  // the header is looked at in another thread
  }
  for (int turn = 0; turn < 3; ++turn) {  // in one thread, what was asked for comes before the turn
    std::promise<void> done;
    network.SubmitAdmitted(0, [&done](int) { done.set_value(); });
    done.get_future().wait();
  }
  EXPECT_EQ(peer.asked(), expected);
  go.set_value();
  EXPECT_OK(peer.Wait());
  EXPECT_EQ(peer.acknowledged(), kBatches);
}

TEST_F(LiveStreamTest, ReadingsOfOpenStepsTakeMemoryThatIsSetAside) {
  constexpr int64_t kLimit = int64_t{20} << 20;
  auto catalogue = Catalogue::Open(folder_.Path("root"), std::chrono::milliseconds(0));
  ASSERT_OK(catalogue.status());
  Services services(
      *std::move(catalogue), *access::Gate::Open(""), int64_t{1} << 30,
      WorkPool::Limits{.name = "lookup queue", .flag = "", .threads = 1, .max_waiting = 100},
      WorkPool::Limits{.name = "render queue", .flag = "", .threads = 1, .max_waiting = 100}, true,
      kLimit);
  std::vector<v1::StreamReadingsRequest> messages = {Header("live")};
  for (uint64_t i = 1; i <= 40; ++i) {
    messages.push_back(Batch(i, 10'000));
    for (auto& time_ns : *messages.back().mutable_batch()->mutable_time_ns()) {
      time_ns = 0;  // all of one step
    }
  }
  FakePeer peer(services, *network_, std::move(messages));
  peer.Start();
  EXPECT_THAT(peer.Wait(), FailsWith(absl::StatusCode::kResourceExhausted, "steps to close"));
  EXPECT_EQ(services.requests.used_bytes(), 0);
}

TEST_F(LiveStreamTest, AFullHouseRefuses) {
  services_->live_streams = LiveStream::kMostStreams;
  const auto peer = MakePeer(Messages("live", 1));
  peer->Start();
  EXPECT_THAT(peer->Wait(), FailsWith(absl::StatusCode::kResourceExhausted, "64 streams"));
  EXPECT_EQ(services_->live_streams, LiveStream::kMostStreams);
}

TEST_F(LiveStreamTest, WhoIsNotLetInIsToldWhy) {
  FakePeer peer(*services_, *network_, {});
  const auto stream = std::make_shared<LiveStream>(*services_, peer);
  stream->Start(Unavailable("not now"), nullptr);
  EXPECT_THAT(peer.Wait(), FailsWith(absl::StatusCode::kUnavailable, "not now"));
}

TEST_F(LiveStreamTest, DrainingStopsAfterWhatIsUnderWay) {
  auto messages = Messages("live", 2);
  messages.back().mutable_batch()->set_last(false);
  std::vector<std::unique_ptr<FakePeer>> peers;
  peers.push_back(MakePeer(std::move(messages)));
  peers.back()->Start();
  services_->steps.Close();
  const Status status = peers.back()->Wait();
  EXPECT_TRUE(absl::IsUnavailable(status) || absl::IsFailedPrecondition(status)) << status;
  EXPECT_EQ(StepsOf("live"), static_cast<int64_t>(peers.back()->acknowledged()));
}

}  // namespace
}  // namespace fovea::server
