#include <algorithm>
#include <vector>

#include "service/access/token_file.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

class ExploreTest : public ServerFixture {
 protected:
  using Stream = grpc::ClientReaderWriter<v1::ExploreRequest, v1::Frame>;

  void SetUp() override {
    ServerFixture::SetUp();
    StartServer();
  }

  v1::Frame Whole(const v1::FrameSpec& spec, uint64_t step) {
    v1::RenderFrameRequest request;
    request.set_dataset("plume");
    request.set_step(step);
    *request.mutable_spec() = spec;
    v1::Frame frame;
    EXPECT_OK(RenderFrame(request, &frame));
    return frame;
  }

  static v1::ExploreRequest View(uint64_t view_id, double azimuth) {
    v1::ExploreRequest request;
    request.set_view_id(view_id);
    request.mutable_spec()->mutable_view()->mutable_orthographic()->set_azimuth_deg(azimuth);
    return request;
  }

  static v1::ExploreRequest First() {
    v1::ExploreRequest request = View(1, 30);
    request.set_dataset("plume");
    v1::FrameSpec spec = SmallSpec();
    spec.set_rate(30);
    *request.mutable_spec() = spec;
    request.set_frame_budget_ms(1);  // less than any frame takes: the lowest rate comes first
    return request;
  }

  /// Reads until the last frame of a view.
  static v1::Frame UntilFinal(Stream& stream, uint64_t view_id, std::vector<v1::Frame>* frames) {
    v1::Frame frame;
    while (stream.Read(&frame)) {
      frames->push_back(frame);
      if (frame.view_id() == view_id && frame.final()) {
        return frame;
      }
    }
    ADD_FAILURE() << "the stream ended before view " << view_id << " was drawn";
    return frame;
  }
};

bool IsBlack(const v1::Frame& frame) {
  return std::all_of(frame.pixels().begin(), frame.pixels().end(), [](char c) { return c == 0; });
}

TEST_F(ExploreTest, RefineFrameBeginsCoarseAndEndsAsRenderFrame) {
  v1::RefineFrameRequest request;
  request.set_dataset("plume");
  request.set_step(2);
  *request.mutable_spec() = SmallSpec();
  request.mutable_spec()->set_rate(30);
  request.set_first_frame_ms(1);
  grpc::ClientContext context;
  const auto reader = render_->RefineFrame(&context, request);
  std::vector<v1::Frame> frames;
  for (v1::Frame frame; reader->Read(&frame);) {
    frames.push_back(frame);
  }
  ASSERT_OK(wire::FromGrpc(reader->Finish()));
  ASSERT_GE(frames.size(), 2U);
  for (size_t i = 0; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].index(), i);
    EXPECT_EQ(frames[i].step(), 2U);
    EXPECT_EQ(frames[i].final(), i + 1 == frames.size());
    EXPECT_FALSE(IsBlack(frames[i])) << i;
    EXPECT_TRUE(i == 0 || frames[i].used().rate() > frames[i - 1].used().rate());
    EXPECT_TRUE(frames[i].pixels() == Whole(frames[i].used(), 2).pixels())
        << "`used`, sent back, gives the same bytes";
  }
  EXPECT_TRUE(frames.back().pixels() == Whole(request.spec(), 2).pixels());
}

TEST_F(ExploreTest, AnAmpleBudgetGivesOneFrame) {
  v1::RefineFrameRequest request;
  request.set_dataset("plume");
  *request.mutable_spec() = SmallSpec();
  request.set_first_frame_ms(10000);
  grpc::ClientContext context;
  const auto reader = render_->RefineFrame(&context, request);
  v1::Frame frame;
  ASSERT_TRUE(reader->Read(&frame));
  EXPECT_TRUE(frame.final());
  EXPECT_FALSE(reader->Read(&frame));
  EXPECT_OK(wire::FromGrpc(reader->Finish()));
}

TEST_F(ExploreTest, WhatChangesIsDrawnOnTopOfWhatWas) {
  grpc::ClientContext context;
  const auto stream = render_->Explore(&context);
  std::vector<v1::Frame> frames;
  ASSERT_TRUE(stream->Write(First()));
  v1::FrameSpec spec = First().spec();
  EXPECT_TRUE(UntilFinal(*stream, 1, &frames).pixels() == Whole(spec, 0).pixels());
  EXPECT_GE(frames.size(), 2U);
  v1::ExploreRequest step;
  step.set_view_id(2);
  step.set_step(4);
  ASSERT_TRUE(stream->Write(step));
  EXPECT_TRUE(UntilFinal(*stream, 2, &frames).pixels() == Whole(spec, 4).pixels());
  ASSERT_TRUE(stream->Write(View(3, 75)));
  spec.mutable_view()->mutable_orthographic()->Clear();
  spec.mutable_view()->mutable_orthographic()->set_azimuth_deg(75);
  EXPECT_TRUE(UntilFinal(*stream, 3, &frames).pixels() == Whole(spec, 4).pixels());
  ASSERT_TRUE(stream->WritesDone());
  v1::Frame frame;
  EXPECT_FALSE(stream->Read(&frame));
  EXPECT_OK(wire::FromGrpc(stream->Finish()));
  for (size_t i = 0; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].index(), i);
  }
}

TEST_F(ExploreTest, ManyViewsAtOnceGiveTheNewestAndFewOthers) {
  constexpr uint64_t kViews = 300;
  grpc::ClientContext context;
  const auto stream = render_->Explore(&context);
  ASSERT_TRUE(stream->Write(First()));
  for (uint64_t view = 2; view <= kViews; ++view) {
    v1::ExploreRequest request = View(view, static_cast<double>(view));
    request.set_moving(view < kViews);
    ASSERT_TRUE(stream->Write(request));
  }
  ASSERT_TRUE(stream->WritesDone());
  std::vector<v1::Frame> frames;
  UntilFinal(*stream, kViews, &frames);
  v1::Frame frame;
  EXPECT_FALSE(stream->Read(&frame));
  EXPECT_OK(wire::FromGrpc(stream->Finish()));
  EXPECT_LT(frames.size(), kViews / 2);
  EXPECT_TRUE(std::is_sorted(frames.begin(), frames.end(), [](const auto& a, const auto& b) {
    return a.view_id() < b.view_id();
  }));
}

TEST_F(ExploreTest, AQuotaOfBytesHoldsViewsBack) {
  access::Token frugal;
  frugal.name = "frugal";
  frugal.digest = access::DigestOf("frugal");
  const auto first_bytes = static_cast<double>(First().ByteSizeLong());
  frugal.quotas.bytes_in_per_second = 2 * first_bytes;
  ASSERT_OK(access::WriteTokenFile(folder_.Path("tokens.json"), {frugal}));
  StartServer(2, 64, folder_.Path("tokens.json"));
  grpc::ClientContext context;
  context.AddMetadata("authorization", "Bearer frugal");
  const auto stream = render_->Explore(&context);
  const auto begin = std::chrono::steady_clock::now();
  std::vector<v1::Frame> frames;
  for (uint64_t view = 1; view <= 5; ++view) {
    v1::ExploreRequest request = First();
    request.set_view_id(view);
    ASSERT_TRUE(stream->Write(request));
  }
  UntilFinal(*stream, 5, &frames);
  // Two may come at once, and a third for what is left; all before the last one are paid for.
  EXPECT_GT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(900));
  ASSERT_TRUE(stream->Write(First()));  // held back when the call ends
  context.TryCancel();
  EXPECT_TRUE(absl::IsCancelled(wire::FromGrpc(stream->Finish())));
}

TEST_F(ExploreTest, AWindowWaitsForAcknowledgements) {
  grpc::ClientContext context;
  const auto stream = render_->Explore(&context);
  v1::ExploreRequest first = First();
  first.set_window(1);
  ASSERT_TRUE(stream->Write(first));
  v1::Frame frame;
  uint64_t index = 0;
  do {
    ASSERT_TRUE(stream->Read(&frame));
    EXPECT_EQ(frame.index(), index++);
    v1::ExploreRequest acknowledgement;
    acknowledgement.set_acknowledged(frame.index());
    ASSERT_TRUE(stream->Write(acknowledgement));
  } while (!frame.final());
  v1::ExploreRequest wrong;
  wrong.set_acknowledged(1000);
  ASSERT_TRUE(stream->Write(wrong));
  EXPECT_FALSE(stream->Read(&frame));
  EXPECT_THAT(wire::FromGrpc(stream->Finish()),
              FailsWith(absl::StatusCode::kInvalidArgument, "acknowledged"));
}

TEST_F(ExploreTest, WhatIsWrongEndsTheStream) {
  const auto ends = [&](const v1::ExploreRequest& request, absl::StatusCode code,
                        const std::string& text) {
    grpc::ClientContext context;
    const auto stream = render_->Explore(&context);
    stream->Write(request);
    v1::Frame frame;
    EXPECT_FALSE(stream->Read(&frame));
    EXPECT_THAT(wire::FromGrpc(stream->Finish()), FailsWith(code, text));
  };
  ends({}, absl::StatusCode::kInvalidArgument, "dataset");
  v1::ExploreRequest request = First();
  request.set_dataset("nothing");
  ends(request, absl::StatusCode::kNotFound, "nothing");
  request = First();
  request.set_step(5);
  ends(request, absl::StatusCode::kOutOfRange, "step 5");
  request = First();
  request.mutable_spec()->mutable_fovea()->mutable_at()->set_x(1000);
  ends(request, absl::StatusCode::kInvalidArgument, "fovea");
}

TEST_F(ExploreTest, LatestIsTheLastStep) {
  grpc::ClientContext context;
  const auto stream = render_->Explore(&context);
  v1::ExploreRequest request = First();
  request.set_latest(true);
  ASSERT_TRUE(stream->Write(request));
  std::vector<v1::Frame> frames;
  EXPECT_EQ(UntilFinal(*stream, 1, &frames).step(), 4U);
  stream->WritesDone();
  EXPECT_OK(wire::FromGrpc(stream->Finish()));
}

TEST_F(ExploreTest, StreamsCancelledAtAnyMomentLeaveNothing) {
  for (int i = 0; i < 60; ++i) {
    grpc::ClientContext context;
    const auto stream = render_->Explore(&context);
    stream->Write(First());
    v1::Frame frame;
    for (int k = 0; k < i % 4 && !frame.final(); ++k) {
      stream->Read(&frame);
    }
    context.TryCancel();
    EXPECT_EQ(wire::FromGrpc(stream->Finish()).code(), absl::StatusCode::kCancelled);
  }
  EXPECT_EQ(server_->Drain(std::chrono::seconds(20)), 0);
}

}  // namespace
}  // namespace fovea::server
