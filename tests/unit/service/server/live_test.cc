// What is live, through gRPC: watches, and streams of frames that follow a dataset.

#include <chrono>
#include <future>
#include <memory>
#include <thread>
#include <vector>

#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

class LiveTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    StartServer();
    context_.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  }
  void AppendSteps(int64_t steps) {
    auto writer = store::DatasetWriter::Append(Root() + "/plume.zarr");
    ASSERT_OK(writer.status());
    ASSERT_OK(store::testing::WriteSteps(writer->get(), steps));
  }
  std::unique_ptr<grpc::ClientReader<v1::DatasetEvent>> Watch(const std::string& dataset,
                                                              uint64_t first_step) {
    v1::WatchDatasetRequest request;
    request.set_dataset(dataset);
    request.set_first_step(first_step);
    return datasets_->WatchDataset(&context_, request);
  }
  v1::RenderSequenceRequest Follow() {
    v1::RenderSequenceRequest request;
    request.set_dataset("plume");
    *request.mutable_spec() = SmallSpec(v1::PNG, 16);
    request.set_follow(true);
    return request;
  }

  grpc::ClientContext context_;
};

TEST_F(LiveTest, AWatchTellsOfStepsOfAnotherProcess) {
  const auto reader = Watch("plume", kSteps - 1);
  v1::DatasetEvent event;
  ASSERT_TRUE(reader->Read(&event));
  EXPECT_EQ(event.state(), v1::DatasetEvent::PRESENT);
  EXPECT_EQ(event.committed_steps(), static_cast<uint64_t>(kSteps));
  ASSERT_EQ(event.steps_size(), 1);
  AppendSteps(1);
  ASSERT_TRUE(reader->Read(&event));
  ASSERT_EQ(event.steps_size(), 1);
  EXPECT_EQ(event.steps(0).step(), static_cast<uint64_t>(kSteps));
  context_.TryCancel();
  EXPECT_FALSE(reader->Read(&event));
  EXPECT_TRUE(absl::IsCancelled(wire::FromGrpc(reader->Finish())));
}

TEST_F(LiveTest, AWatchNeedsADataset) {
  v1::DatasetEvent event;
  auto reader = Watch("", 0);
  EXPECT_FALSE(reader->Read(&event));
  EXPECT_THAT(wire::FromGrpc(reader->Finish()),
              FailsWith(absl::StatusCode::kInvalidArgument, "dataset"));
}

TEST_F(LiveTest, AWatchOfNothingIsNotFound) {
  v1::DatasetEvent event;
  const auto reader = Watch("nothing", 0);
  EXPECT_FALSE(reader->Read(&event));
  EXPECT_THAT(wire::FromGrpc(reader->Finish()), FailsWith(absl::StatusCode::kNotFound, "nothing"));
}

TEST_F(LiveTest, FollowingBeginsWithTheLastStepAndGoesOn) {
  const auto reader = render_->RenderSequence(&context_, Follow());
  v1::Frame frame;
  ASSERT_TRUE(reader->Read(&frame));
  EXPECT_EQ(frame.step(), static_cast<uint64_t>(kSteps - 1));
  EXPECT_EQ(frame.index(), 0U);
  for (int64_t i = 0; i < 3; ++i) {
    AppendSteps(1);
    ASSERT_TRUE(reader->Read(&frame));
    EXPECT_EQ(frame.step(), static_cast<uint64_t>(kSteps + i));
    EXPECT_EQ(frame.index(), static_cast<uint64_t>(1 + i));
  }
  context_.TryCancel();
  EXPECT_FALSE(reader->Read(&frame));
}

TEST_F(LiveTest, FollowingAfterARangeAndByStrides) {
  v1::RenderSequenceRequest request = Follow();
  request.mutable_steps()->set_stride(2);
  const auto reader = render_->RenderSequence(&context_, request);
  v1::Frame frame;
  for (uint64_t i = 0; i < 3; ++i) {
    ASSERT_TRUE(reader->Read(&frame));
    EXPECT_EQ(frame.step(), 2 * i);
  }
  AppendSteps(5);  // steps 5 to 9, committed together: only 8 is shown
  ASSERT_TRUE(reader->Read(&frame));
  while (frame.step() < 8) {
    ASSERT_TRUE(reader->Read(&frame));
    EXPECT_EQ(frame.step() % 2, 0U);
  }
  EXPECT_EQ(frame.index(), 4U);
  context_.TryCancel();
  EXPECT_FALSE(reader->Read(&frame));
}

TEST_F(LiveTest, FollowingHasNoLastStep) {
  v1::RenderSequenceRequest request = Follow();
  request.mutable_steps()->set_last(3);
  const auto reader = render_->RenderSequence(&context_, request);
  v1::Frame frame;
  EXPECT_FALSE(reader->Read(&frame));
  EXPECT_THAT(wire::FromGrpc(reader->Finish()),
              FailsWith(absl::StatusCode::kInvalidArgument, "steps.last"));
}

TEST_F(LiveTest, DrainingEndsWhatHasNoEnd) {
  const auto events = Watch("plume", 0);
  v1::DatasetEvent event;
  ASSERT_TRUE(events->Read(&event));
  grpc::ClientContext context;
  const auto frames = render_->RenderSequence(&context, Follow());
  v1::Frame frame;
  ASSERT_TRUE(frames->Read(&frame));
  auto drained =
      std::async(std::launch::async, [this] { return server_->Drain(std::chrono::seconds(30)); });
  EXPECT_FALSE(events->Read(&event));
  EXPECT_FALSE(frames->Read(&frame));
  EXPECT_THAT(wire::FromGrpc(events->Finish()),
              FailsWith(absl::StatusCode::kUnavailable, "shutting down"));
  EXPECT_THAT(wire::FromGrpc(frames->Finish()),
              FailsWith(absl::StatusCode::kUnavailable, "shutting down"));
  EXPECT_EQ(drained.get(), 0);
}

}  // namespace
}  // namespace fovea::server
