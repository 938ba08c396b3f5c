// Streams on real pools and a real store, with threads in gRPC's place: everything about them that
// a thread sanitizer can follow.

#include "service/server/sequence_stream.h"

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

constexpr int64_t kSteps = 4;

/// A client on threads of its own: takes each frame, acknowledges it, and may cancel.
class FakeClient final : public FrameSink {
 public:
  FakeClient(Services& services, WorkPool& network, const std::string& stream_id, uint32_t window)
      : services_(services), network_(network), stream_id_(stream_id) {
    request_.dataset = "plume";
    request_.spec.width_px = 16;
    request_.spec.height_px = 12;
    request_.spec.encoding = frames::Encoding::kRawRgba8;
    request_.window = window;
    request_.stream_id = stream_id;
    stream_ = std::make_shared<SequenceStream>(services, *this, window);
  }

  void set_cancel_at(uint64_t index) { cancel_at_ = index; }
  void Start() { stream_->Start(request_, *services_.gate->Identify({})); }
  void Cancel() { stream_->OnCancel(); }
  /// How it ended.
  Status Wait() { return end_.get_future().get(); }
  /// Frames that came, in order. After Wait.
  [[nodiscard]] uint64_t frames() const { return frames_; }

  void Write(const v1::Frame& frame) override {
    EXPECT_EQ(frame.index(), frames_);
    EXPECT_EQ(frame.pixels().size(), 16U * 12 * 4);
    ++frames_;
    network_.SubmitAdmitted(0, [this, index = frame.index()](int) { Deliver(index); });
  }
  void Finish(const Status& status) override {
    end_.set_value(status);
  }  // throws if it comes twice

 private:
  void Deliver(uint64_t index) {
    const auto stream = stream_;
    if (index == cancel_at_) {
      network_.SubmitAdmitted(0, [stream](int) { stream->OnCancel(); });
      stream->OnWriteDone(false);
      return;
    }
    if (!stream_id_.empty()) {
      network_.SubmitAdmitted(0, [&services = services_, id = stream_id_, index](int) {
        if (const auto found = services.streams.Find("", id)) {
          EXPECT_OK(found->Acknowledge(index));
        }
      });
    }
    stream->OnWriteDone(true);
  }

  Services& services_;
  WorkPool& network_;
  const std::string stream_id_;
  wire::SequenceRequest request_;
  uint64_t cancel_at_ = ~uint64_t{0};
  std::shared_ptr<SequenceStream> stream_;
  uint64_t frames_ = 0;  // writes come one at a time
  std::promise<Status> end_;
};

class SequenceStreamTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string root = folder_.Path("root");
    std::filesystem::create_directories(root);
    ASSERT_OK(store::testing::MakeStore(root + "/plume.zarr",
                                        store::testing::MakeInfo({20, 18, 16}, 8), kSteps));
    auto catalogue = Catalogue::Open(root, std::chrono::milliseconds(0));
    ASSERT_OK(catalogue.status());
    services_ = std::make_unique<Services>(
        *std::move(catalogue), *access::Gate::Open(""), int64_t{1} << 30,
        WorkPool::Limits{.name = "lookup queue", .flag = "", .threads = 2, .max_waiting = 100},
        WorkPool::Limits{.name = "render queue", .flag = "", .threads = 3, .max_waiting = 100});
    network_ = std::make_unique<WorkPool>(
        WorkPool::Limits{.name = "network", .flag = "", .threads = 3, .max_waiting = 100});
  }

  void TearDown() override {
    network_.reset();  // what it still delivers is of streams that are over
    clients_.clear();
    services_.reset();
  }

  std::unique_ptr<FakeClient> MakeClient(const std::string& stream_id, uint32_t window) {
    return std::make_unique<FakeClient>(*services_, *network_, stream_id, window);
  }

  store::testing::TemporaryFolder folder_;
  std::vector<std::unique_ptr<FakeClient>> clients_;
  std::unique_ptr<Services> services_;
  std::unique_ptr<WorkPool> network_;
};

TEST_F(SequenceStreamTest, ManyStreamsPacedAndCancelledAtRandom) {
  for (int i = 0; i < 24; ++i) {
    const auto window = static_cast<uint32_t>(i % 3);
    clients_.push_back(MakeClient(window == 0 ? "" : "stream-" + std::to_string(i), window));
    if (i % 4 == 3) {
      clients_.back()->set_cancel_at(static_cast<uint64_t>(i % kSteps));
    }
  }
  for (const auto& client : clients_) {
    client->Start();
  }
  for (size_t i = 0; i < clients_.size(); ++i) {
    const Status end = clients_[i]->Wait();
    if (i % 4 == 3) {
      EXPECT_EQ(end.code(), absl::StatusCode::kCancelled) << i;
      EXPECT_LE(clients_[i]->frames(), i % kSteps + 1);
    } else {
      EXPECT_OK(end) << i;
      EXPECT_EQ(clients_[i]->frames(), static_cast<uint64_t>(kSteps)) << i;
    }
  }
}

TEST_F(SequenceStreamTest, ACancelFromOutsideEndsItAtAnyTime) {
  for (int i = 0; i < 40; ++i) {
    clients_.push_back(MakeClient("", 0));
    FakeClient& client = *clients_.back();
    client.Start();
    for (int k = 0; k < i * 50; ++k) {
      std::this_thread::yield();
    }
    client.Cancel();
    const Status end = client.Wait();
    EXPECT_TRUE(absl::IsCancelled(end) || client.frames() == kSteps) << MessageOf(end);
  }
}

TEST_F(SequenceStreamTest, AnErrorIsTheEnd) {
  auto client = MakeClient("same-id", 1);
  auto twin = MakeClient("same-id", 1);
  ASSERT_OK(services_->streams.Add("", "same-id", {}));
  client->Start();
  EXPECT_THAT(client->Wait(), FailsWith(absl::StatusCode::kAlreadyExists, "same-id"));
  services_->streams.Remove("", "same-id");
  twin->Start();
  EXPECT_OK(twin->Wait());
  EXPECT_EQ(services_->streams.Find("", "same-id"), nullptr);
  clients_.push_back(std::move(client));
  clients_.push_back(std::move(twin));
}

}  // namespace
}  // namespace fovea::server
