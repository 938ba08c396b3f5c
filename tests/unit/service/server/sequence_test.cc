#include <functional>
#include <future>
#include <thread>
#include <vector>

#include <grpcpp/generic/generic_stub.h>

#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr char kStreamId[] = "stream-0123456789";

class SequenceTest : public ServerFixture {
 protected:
  static v1::RenderSequenceRequest Request(uint32_t window, const std::string& stream_id = "") {
    v1::RenderSequenceRequest request;
    request.set_dataset("plume");
    *request.mutable_spec() = SmallSpec();
    request.set_window(window);
    request.set_stream_id(stream_id);
    return request;
  }

  /// One stream, read by hand.
  struct Stream {
    Stream(v1::Render::Stub& stub, const v1::RenderSequenceRequest& request)
        : reader(stub.RenderSequence(&context, request)) {}
    Status Finish() { return wire::FromGrpc(reader->Finish()); }
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::Frame>> reader;
  };

  std::vector<v1::Frame> ReadAll(const v1::RenderSequenceRequest& request) {
    Stream stream(*render_, request);
    std::vector<v1::Frame> frames;
    v1::Frame frame;
    while (stream.reader->Read(&frame)) {
      frames.push_back(frame);
    }
    EXPECT_OK(stream.Finish());
    return frames;
  }

  /// Until the server has forgotten the stream: the end of a call reaches it when it does.
  bool IsGone(const std::string& stream_id) {
    const auto limit = std::chrono::steady_clock::now() + seconds(20);
    while (std::chrono::steady_clock::now() < limit) {
      if (absl::IsNotFound(Acknowledge(stream_id, 0))) {
        return true;
      }
      std::this_thread::yield();
    }
    return false;
  }
};

TEST_F(SequenceTest, SendsEveryStepInOrder) {
  StartServer();
  const std::vector<v1::Frame> frames = ReadAll(Request(0));
  ASSERT_EQ(frames.size(), 5U);
  for (size_t i = 0; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].index(), i);
    EXPECT_EQ(frames[i].step(), i);
    v1::RenderFrameRequest single;
    single.set_dataset("plume");
    single.set_step(i);
    *single.mutable_spec() = SmallSpec();
    v1::Frame frame;
    ASSERT_OK(RenderFrame(single, &frame));
    EXPECT_TRUE(frame.pixels() == frames[i].pixels()) << i;
  }
}

TEST_F(SequenceTest, ARangeAndAResumedRange) {
  StartServer();
  v1::RenderSequenceRequest request = Request(0);
  request.mutable_steps()->set_first(0);
  request.mutable_steps()->set_last(4);
  request.mutable_steps()->set_stride(2);
  const std::vector<v1::Frame> all = ReadAll(request);
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all[2].step(), 4U);
  request.set_start_index(1);
  const std::vector<v1::Frame> rest = ReadAll(request);
  ASSERT_EQ(rest.size(), 2U);
  for (size_t i = 0; i < rest.size(); ++i) {
    EXPECT_EQ(rest[i].index(), i + 1);
    EXPECT_EQ(rest[i].step(), all[i + 1].step());
    EXPECT_TRUE(rest[i].pixels() == all[i + 1].pixels());
  }
  request.set_start_index(3);
  EXPECT_TRUE(ReadAll(request).empty());
}

TEST_F(SequenceTest, WrongRequestsGetTheirCode) {
  StartServer();
  const auto finish = [&](const v1::RenderSequenceRequest& request) {
    return Stream(*render_, request).Finish();
  };
  v1::RenderSequenceRequest request = Request(2);
  EXPECT_EQ(wire::FieldOf(finish(request)), "stream_id");
  request = Request(0);
  request.set_start_index(6);
  EXPECT_EQ(wire::FieldOf(finish(request)), "start_index");
  request = Request(0);
  request.mutable_steps()->set_last(5);
  EXPECT_THAT(finish(request), FailsWith(absl::StatusCode::kOutOfRange, "steps 0 to 4"));
  request = Request(0);
  request.set_dataset("../plume");
  EXPECT_EQ(finish(request).code(), absl::StatusCode::kNotFound);
  request = Request(0);
  request.mutable_spec()->mutable_fovea()->mutable_at()->set_z(-1);
  EXPECT_EQ(wire::FieldOf(finish(request)), "spec.fovea");
  EXPECT_EQ(server_->frames_rendered(), 0U);
}

/// Frame k of a path is, to the byte, what RenderFrame draws of the spec that is interpolated.
class PathTest : public SequenceTest {
 protected:
  void ExpectAsSingleFrames(const v1::RenderSequenceRequest& request,
                            const std::vector<v1::Frame>& frames,
                            const std::function<uint64_t(double, v1::FrameSpec*)>& at) {
    for (const v1::Frame& frame : frames) {
      v1::RenderFrameRequest single;
      single.set_dataset(request.dataset());
      *single.mutable_spec() = request.spec();
      single.set_step(at(static_cast<double>(frame.index()), single.mutable_spec()));
      v1::Frame expected;
      ASSERT_OK(RenderFrame(single, &expected));
      EXPECT_EQ(frame.step(), single.step()) << frame.index();
      EXPECT_TRUE(frame.pixels() == expected.pixels()) << frame.index();
      EXPECT_EQ(frame.used().SerializeAsString(), expected.used().SerializeAsString());
    }
  }
};

TEST_F(PathTest, ViewFoveaRateSpanAndStepMove) {
  StartServer();
  v1::RenderSequenceRequest request = Request(0);
  request.mutable_path()->set_frames(9);
  v1::Keyframe* first = request.mutable_path()->add_keys();
  first->mutable_view()->set_azimuth_deg(-40);
  first->mutable_view()->set_elevation_deg(80);
  first->mutable_fovea()->set_x(4);
  first->set_span_voxels(40);
  first->set_step(1);
  v1::Keyframe* last = request.mutable_path()->add_keys();
  last->set_frame(8);
  last->mutable_view()->set_azimuth_deg(360);
  last->mutable_view()->set_elevation_deg(-80);
  last->mutable_fovea()->set_y(36);
  last->mutable_fovea()->set_z(10);
  last->set_span_voxels(80);
  last->set_rate(7);  // alone: the same all along
  last->set_step(4);
  const auto frames = ReadAll(request);
  ASSERT_EQ(frames.size(), 9U);
  const auto at = [](double k, v1::FrameSpec* spec) {
    auto* view = spec->mutable_view()->mutable_orthographic();
    view->set_azimuth_deg(-40 + k / 8 * 400);
    view->set_elevation_deg(80 - k / 8 * 160);
    view->set_span_voxels(40 + k / 8 * 40);
    auto* fovea = spec->mutable_fovea()->mutable_at();
    fovea->set_x(4 - k / 8 * 4);
    fovea->set_y(k / 8 * 36);
    fovea->set_z(k / 8 * 10);
    spec->set_rate(7);
    return static_cast<uint64_t>(1 + k / 8 * 3 + 0.5);
  };
  ExpectAsSingleFrames(request, frames, at);
  request.set_start_index(6);  // to resume
  const auto rest = ReadAll(request);
  ASSERT_EQ(rest.size(), 3U);
  ExpectAsSingleFrames(request, rest, at);
  request.set_start_index(9);
  EXPECT_TRUE(ReadAll(request).empty());
}

TEST_F(PathTest, ACameraFliesAndFramesAreSpreadOverTheSteps) {
  StartServer();
  v1::RenderSequenceRequest request = Request(0);
  request.mutable_spec()->clear_view();
  request.mutable_spec()->set_mode(v1::MODE_AUTO);  // fused, if it were not for the camera
  request.mutable_steps()->set_first(1);
  request.mutable_steps()->set_stride(2);  // 1, 3
  request.mutable_path()->set_frames(5);
  v1::Keyframe* first = request.mutable_path()->add_keys();
  first->mutable_eye()->set_x(-64);
  first->set_fov_y_deg(60);
  v1::Keyframe* last = request.mutable_path()->add_keys();
  last->set_frame(4);
  last->mutable_eye()->set_z(80);
  const auto frames = ReadAll(request);
  ASSERT_EQ(frames.size(), 5U);
  ExpectAsSingleFrames(request, frames, [](double k, v1::FrameSpec* spec) -> uint64_t {
    auto* view = spec->mutable_view()->mutable_perspective();
    view->mutable_eye()->mutable_at()->set_x(-64 + k / 4 * 64);
    view->mutable_eye()->mutable_at()->set_z(k / 4 * 80);
    view->set_fov_y_deg(60);
    return k < 3 ? 1 : 3;
  });
}

TEST_F(PathTest, FramesByDefaultAreTheSteps) {
  StartServer();
  v1::RenderSequenceRequest request = Request(0);
  request.mutable_spec()->set_encoding(v1::FOVEATED);  // whose bound grows with the rate
  request.mutable_path()->add_keys()->set_rate(1);
  v1::Keyframe* last = request.mutable_path()->add_keys();
  last->set_frame(4);
  last->set_rate(33);
  const auto frames = ReadAll(request);
  ASSERT_EQ(frames.size(), 5U);
  ExpectAsSingleFrames(request, frames, [](double k, v1::FrameSpec* spec) {
    spec->set_rate(1 + 8 * k);
    return static_cast<uint64_t>(k);
  });
}

TEST_F(PathTest, WhatCannotBeIsSaidBeforeTheFirstFrame) {
  StartServer();
  const auto finish = [&](const std::function<void(v1::Keyframe*)>& spoil) {
    v1::RenderSequenceRequest request = Request(0);
    request.mutable_path()->add_keys()->set_rate(8);
    v1::Keyframe* key = request.mutable_path()->add_keys();
    key->set_frame(5);
    spoil(key);
    return Stream(*render_, request).Finish();
  };
  EXPECT_EQ(wire::FieldOf(finish([](auto* key) { key->mutable_fovea()->set_z(31); })),
            "path.keys[1].fovea");
  EXPECT_EQ(wire::FieldOf(finish([](auto* key) {
              key->mutable_eye()->set_x(3);
              key->mutable_target()->set_x(3);
            })),
            "path.keys[1].target");  // it is there all along
  EXPECT_EQ(wire::FieldOf(finish([](auto* key) { key->set_frame(6); })), "path.keys[1].frame");
  EXPECT_THAT(finish([](auto* key) { key->set_step(5); }),
              FailsWith(absl::StatusCode::kOutOfRange, "path.keys[1].step"));
  EXPECT_EQ(server_->frames_rendered(), 0U);
}

TEST_F(PathTest, AFrameBetweenTwoThatCannotBeEndsIt) {
  StartServer();
  v1::RenderSequenceRequest request = Request(0);
  for (const double x : {-10.0, 10.0}) {  // through the target, at frame 2 of 0 to 4
    v1::Keyframe* key = request.mutable_path()->add_keys();
    key->set_frame(x < 0 ? 0 : 4);
    key->mutable_eye()->set_x(x);
    key->mutable_target();
  }
  Stream stream(*render_, request);
  v1::Frame frame;
  EXPECT_TRUE(stream.reader->Read(&frame));
  EXPECT_TRUE(stream.reader->Read(&frame));
  EXPECT_FALSE(stream.reader->Read(&frame));
  EXPECT_EQ(stream.Finish().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(SequenceTest, RendersNoFurtherThanTheWindow) {
  StartServer(1);
  Stream stream(*render_, Request(2, kStreamId));
  v1::Frame frame;
  ASSERT_TRUE(stream.reader->Read(&frame));
  ASSERT_TRUE(stream.reader->Read(&frame));
  EXPECT_EQ(frame.index(), 1U);
  Flush();
  EXPECT_EQ(server_->frames_rendered(), 3U);  // two, and the one of Flush
  ASSERT_OK(Acknowledge(kStreamId, 0));
  ASSERT_TRUE(stream.reader->Read(&frame));
  EXPECT_EQ(frame.index(), 2U);
  Flush();
  EXPECT_EQ(server_->frames_rendered(), 5U);
  EXPECT_THAT(Acknowledge(kStreamId, 3), FailsWith(absl::StatusCode::kInvalidArgument, "index"));
  ASSERT_OK(Acknowledge(kStreamId, 2));
  ASSERT_TRUE(stream.reader->Read(&frame));
  ASSERT_TRUE(stream.reader->Read(&frame));
  EXPECT_EQ(frame.index(), 4U);
  EXPECT_FALSE(stream.reader->Read(&frame));
  EXPECT_OK(stream.Finish());
  EXPECT_EQ(Acknowledge(kStreamId, 4).code(), absl::StatusCode::kNotFound);
}

TEST_F(SequenceTest, AStreamIdIsForOneStreamAtATime) {
  StartServer();
  Stream first(*render_, Request(1, kStreamId));
  v1::Frame frame;
  ASSERT_TRUE(first.reader->Read(&frame));
  EXPECT_THAT(Stream(*render_, Request(1, kStreamId)).Finish(),
              FailsWith(absl::StatusCode::kAlreadyExists, kStreamId));
  ASSERT_OK(Acknowledge(kStreamId, 0));  // the first one goes on
  ASSERT_TRUE(first.reader->Read(&frame));
  first.context.TryCancel();
  EXPECT_EQ(first.Finish().code(), absl::StatusCode::kCancelled);
  ASSERT_TRUE(IsGone(kStreamId));
  Stream again(*render_, Request(1, kStreamId));
  EXPECT_TRUE(again.reader->Read(&frame));
  again.context.TryCancel();
}

TEST_F(SequenceTest, ACancelStopsWork) {
  StartServer(1);
  v1::RenderSequenceRequest request = Request(0, kStreamId);
  *request.mutable_spec() = SmallSpec(v1::RAW_RGBA_F32, 512);  // far above HTTP/2's window
  Stream stream(*render_, request);
  v1::Frame frame;
  ASSERT_TRUE(stream.reader->Read(&frame));
  stream.context.TryCancel();
  EXPECT_EQ(stream.Finish().code(), absl::StatusCode::kCancelled);
  ASSERT_TRUE(IsGone(kStreamId));
  Flush();  // the frame that was in hand is done
  const uint64_t rendered = server_->frames_rendered();
  EXPECT_LE(rendered, 5U);  // read, being written, ready, in hand; and the one of Flush
  Flush();
  EXPECT_EQ(server_->frames_rendered(), rendered + 1);
}

TEST_F(SequenceTest, ASlowClientHoldsFewFrames) {
  StartServer(1);
  v1::RenderSequenceRequest request = Request(0, kStreamId);
  *request.mutable_spec() = SmallSpec(v1::RAW_RGBA_F32, 512);
  Stream stream(*render_, request);
  v1::Frame frame;
  for (uint64_t i = 0; i < 5; ++i) {
    ASSERT_TRUE(stream.reader->Read(&frame));
    Flush();
    Flush();
    // Beyond those that were read: one on its way, one being written, one ready, one in hand.
    EXPECT_LE(server_->frames_rendered(), (i + 1) + 4 + 2 * (i + 1));
  }
  EXPECT_FALSE(stream.reader->Read(&frame));
  EXPECT_OK(stream.Finish());
}

TEST_F(SequenceTest, ADeadlineEndsAStreamThatWaits) {
  StartServer();
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + milliseconds(500));
  const auto reader = render_->RenderSequence(&context, Request(1, kStreamId));
  v1::Frame frame;
  ASSERT_TRUE(reader->Read(&frame));
  EXPECT_FALSE(reader->Read(&frame));
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(IsGone(kStreamId));
  EXPECT_LE(server_->frames_rendered(), 2U);  // work stops within one frame of the cancel
}

TEST_F(SequenceTest, AClientThatVanishesFreesItsStream) {
  StartServer();
  {
    const auto channel =
        grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
    const auto stub = v1::Render::NewStub(channel);
    Stream stream(*stub, Request(1, kStreamId));
    v1::Frame frame;
    ASSERT_TRUE(stream.reader->Read(&frame));
  }
  EXPECT_TRUE(IsGone(kStreamId));
}

TEST_F(SequenceTest, StreamsRunSideBySide) {
  StartServer();
  const std::vector<v1::Frame> alone = ReadAll(Request(0));
  std::vector<std::future<std::vector<v1::Frame>>> streams;
  for (int i = 0; i < 4; ++i) {
    streams.push_back(std::async(std::launch::async, [&] { return ReadAll(Request(0)); }));
  }
  for (auto& stream : streams) {
    const std::vector<v1::Frame> frames = stream.get();
    ASSERT_EQ(frames.size(), alone.size());
    for (size_t i = 0; i < frames.size(); ++i) {
      EXPECT_TRUE(frames[i].pixels() == alone[i].pixels());
    }
  }
}

TEST_F(SequenceTest, DrainsWhatRunsAndRefusesWhatComes) {
  StartServer();
  Stream stream(*render_, Request(1, kStreamId));
  v1::Frame frame;
  ASSERT_TRUE(stream.reader->Read(&frame));
  auto drained = std::async(std::launch::async, [&] { return server_->Drain(seconds(60)); });
  v1::RenderFrameRequest single;
  single.set_dataset("plume");
  *single.mutable_spec() = SmallSpec();
  Status status;
  const auto limit = std::chrono::steady_clock::now() + seconds(20);
  do {
    v1::Frame ignored;
    status = RenderFrame(single, &ignored);
  } while (status.ok() && std::chrono::steady_clock::now() < limit);
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kUnavailable, "shutting down"));
  EXPECT_THAT(Stream(*render_, Request(0)).Finish(),
              FailsWith(absl::StatusCode::kUnavailable, "shutting down"));
  // Acknowledgements still come through, or the stream could never end.
  uint64_t frames = 1;
  do {
    ASSERT_OK(Acknowledge(kStreamId, frame.index()));
    frames += stream.reader->Read(&frame) ? 1 : 0;
  } while (frames < 5);
  EXPECT_FALSE(stream.reader->Read(&frame));
  EXPECT_OK(stream.Finish());
  EXPECT_EQ(drained.get(), 0);
}

TEST_F(SequenceTest, ADrainCutsWhatTakesTooLong) {
  StartServer();
  Stream stream(*render_, Request(1, kStreamId));
  v1::Frame frame;
  ASSERT_TRUE(stream.reader->Read(&frame));
  EXPECT_EQ(server_->Drain(milliseconds(10)), 1);
  EXPECT_FALSE(stream.reader->Read(&frame));
  EXPECT_FALSE(stream.Finish().ok());
}

}  // namespace
}  // namespace fovea::server
