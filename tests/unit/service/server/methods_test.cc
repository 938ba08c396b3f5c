#include <future>
#include <limits>
#include <vector>

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>

#include "service/frames/foveated_picture.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;

class MethodsTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    StartServer();
  }

  static v1::RenderFrameRequest Request(v1::Encoding encoding = v1::RAW_RGBA_F32) {
    v1::RenderFrameRequest request;
    request.set_dataset("plume");
    request.set_step(3);
    *request.mutable_spec() = SmallSpec(encoding);
    return request;
  }

  /// A unary call by name, in bytes.
  grpc::Status CallRaw(const std::string& method, const std::string& bytes, std::string* reply) {
    grpc::GenericStub stub(channel_);
    grpc::ClientContext context;
    grpc::Slice slice(bytes);
    grpc::ByteBuffer request(&slice, 1);
    grpc::ByteBuffer response;
    std::promise<grpc::Status> done;
    stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &response,
                   [&](grpc::Status status) { done.set_value(std::move(status)); });
    const grpc::Status status = done.get_future().get();
    std::vector<grpc::Slice> slices;
    if (status.ok() && response.Dump(&slices).ok()) {
      for (const grpc::Slice& part : slices) {
        reply->append(reinterpret_cast<const char*>(part.begin()), part.size());
      }
    }
    return status;
  }
};

TEST_F(MethodsTest, ListsDatasets) {
  grpc::ClientContext context;
  v1::ListDatasetsResponse response;
  ASSERT_TRUE(datasets_->ListDatasets(&context, v1::ListDatasetsRequest(), &response).ok());
  ASSERT_EQ(response.datasets_size(), 2);
  EXPECT_EQ(response.datasets(0).name(), "lab/other");
  EXPECT_EQ(response.datasets(1).name(), "plume");
  EXPECT_EQ(response.datasets(1).committed_steps(), 5U);
  EXPECT_EQ(response.next_page_token(), "");
}

TEST_F(MethodsTest, ListsDatasetsInPages) {
  v1::ListDatasetsRequest request;
  request.set_page_size(1);
  std::vector<std::string> names;
  do {
    grpc::ClientContext context;
    v1::ListDatasetsResponse response;
    ASSERT_TRUE(datasets_->ListDatasets(&context, request, &response).ok());
    ASSERT_EQ(response.datasets_size(), 1);
    names.push_back(response.datasets(0).name());
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_THAT(names, ::testing::ElementsAre("lab/other", "plume"));
}

TEST_F(MethodsTest, DescribesADataset) {
  grpc::ClientContext context;
  v1::GetDatasetRequest request;
  request.set_dataset("lab/other");
  v1::Dataset dataset;
  ASSERT_TRUE(datasets_->GetDataset(&context, request, &dataset).ok());
  EXPECT_EQ(dataset.nx(), 40U);
  EXPECT_EQ(dataset.nz(), 30U);
  EXPECT_EQ(dataset.committed_steps(), 1U);
  ASSERT_EQ(dataset.fields_size(), 2);
  EXPECT_EQ(dataset.fields(1).name(), "heat");
  EXPECT_LT(dataset.fields(0).minimum(), dataset.fields(0).maximum());
  EXPECT_EQ(dataset.default_field(), "density");
  EXPECT_EQ(dataset.wavelet(), "haar");
  EXPECT_EQ(dataset.index_to_world_size(), 16);
  EXPECT_EQ(dataset.first_time_ns(), dataset.last_time_ns());
  EXPECT_EQ(dataset.default_spec().width_px(), 512U);
  EXPECT_GE(dataset.default_spec().rate(), 1);
  EXPECT_GT(dataset.default_spec().transfer_function().points_size(), 0);
}

TEST_F(MethodsTest, UnknownDatasetsAreNotFound) {
  for (const char* name : {"nothing", "../root/plume", "lab/../plume", "/etc", "plume.zarr"}) {
    grpc::ClientContext context;
    v1::GetDatasetRequest get;
    get.set_dataset(name);
    v1::Dataset dataset;
    EXPECT_EQ(datasets_->GetDataset(&context, get, &dataset).error_code(),
              grpc::StatusCode::NOT_FOUND)
        << name;
    v1::RenderFrameRequest request = Request();
    request.set_dataset(name);
    v1::Frame frame;
    EXPECT_THAT(RenderFrame(request, &frame), FailsWith(absl::StatusCode::kNotFound, name));
  }
}

TEST_F(MethodsTest, AFoveatedFrameExpandsToTheServersPicture) {
  v1::Frame frame;
  ASSERT_OK(RenderFrame(Request(v1::FOVEATED), &frame));
  ASSERT_OK_AND_ASSIGN(const frames::Frame foveated, wire::FromProto(std::move(frame)));
  for (const auto encoding : {v1::RAW_RGBA8, v1::PNG, v1::JPEG}) {
    v1::Frame picture;
    ASSERT_OK(RenderFrame(Request(encoding), &picture));
    ASSERT_OK_AND_ASSIGN(
        const frames::Frame expanded,
        frames::ExpandFrame(foveated, *wire::EncodingFromProto(encoding, "encoding")));
    EXPECT_TRUE(expanded.pixels == picture.pixels()) << encoding;
  }
}

TEST_F(MethodsTest, AFrameHasTheBytesOfTheSameFrameInProcess) {
  for (const auto encoding : {v1::RAW_RGBA_F32, v1::RAW_RGBA8, v1::PNG, v1::JPEG, v1::FOVEATED}) {
    v1::Frame frame;
    ASSERT_OK(RenderFrame(Request(encoding), &frame));
    ASSERT_OK_AND_ASSIGN(const frames::Frame expected,
                         InProcess(Root() + "/plume.zarr", 3, SmallSpec(encoding)));
    EXPECT_TRUE(frame.pixels() == expected.pixels) << encoding;
    EXPECT_EQ(frame.encoding(), encoding);
    EXPECT_EQ(frame.width_px(), 48U);
    EXPECT_EQ(frame.step(), 3U);
    EXPECT_EQ(frame.dataset(), "plume");
    EXPECT_EQ(frame.time_ns(), expected.time_ns);
    EXPECT_GT(frame.stats().coefficients(), 0U);
    EXPECT_GT(frame.stats().samples(), 0U);
  }
}

TEST_F(MethodsTest, WhatWasUsedGivesTheSameBytesAgain) {
  v1::RenderFrameRequest request;
  request.set_dataset("lab/other");
  request.mutable_spec()->set_field("heat");
  request.mutable_spec()->set_width_px(64);
  request.mutable_spec()->set_fovea_marker(true);
  v1::Frame first;
  ASSERT_OK(RenderFrame(request, &first));
  *request.mutable_spec() = first.used();
  v1::Frame second;
  ASSERT_OK(RenderFrame(request, &second));
  EXPECT_TRUE(first.pixels() == second.pixels());
  EXPECT_EQ(first.used().SerializeAsString(), second.used().SerializeAsString());
  EXPECT_EQ(first.used().field(), "heat");
  EXPECT_EQ(first.used().height_px(), 512U);
}

TEST_F(MethodsTest, ATimeFallsOnTheLastStepNotAfterIt) {
  v1::Frame at_step;
  ASSERT_OK(RenderFrame(Request(), &at_step));
  v1::RenderFrameRequest request = Request();
  request.set_time_ns(at_step.time_ns() + 5);
  v1::Frame at_time;
  ASSERT_OK(RenderFrame(request, &at_time));
  EXPECT_EQ(at_time.step(), 3U);
  EXPECT_TRUE(at_time.pixels() == at_step.pixels());
}

struct BadFrame {
  const char* field;  // what the details point at; empty: nothing
  absl::StatusCode code;
  const char* text;
  void (*spoil)(v1::RenderFrameRequest* request);
};

const BadFrame kBadFrames[] = {
    {"spec.rate", absl::StatusCode::kInvalidArgument, "1 to 65536",
     [](v1::RenderFrameRequest* r) { r->mutable_spec()->set_rate(0); }},
    {"spec.width_px", absl::StatusCode::kInvalidArgument, "100000",
     [](v1::RenderFrameRequest* r) { r->mutable_spec()->set_width_px(100'000); }},
    {"spec.width_px", absl::StatusCode::kInvalidArgument, "67108864",
     [](v1::RenderFrameRequest* r) {
       r->mutable_spec()->set_width_px(4096);
       r->mutable_spec()->set_height_px(2048);
     }},
    {"spec.fovea", absl::StatusCode::kInvalidArgument, "0 to 40",
     [](v1::RenderFrameRequest* r) {
       r->mutable_spec()->mutable_fovea()->mutable_at()->set_x(41);
     }},
    {"spec.encoding", absl::StatusCode::kInvalidArgument, "42",
     [](v1::RenderFrameRequest* r) { r->mutable_spec()->set_encoding(v1::Encoding(42)); }},
    {"spec.view.orthographic.azimuth_deg", absl::StatusCode::kInvalidArgument, "finite",
     [](v1::RenderFrameRequest* r) {
       r->mutable_spec()->mutable_view()->mutable_orthographic()->set_azimuth_deg(
           std::numeric_limits<double>::quiet_NaN());
     }},
    {"spec.view.perspective.eye", absl::StatusCode::kInvalidArgument, "missing",
     [](v1::RenderFrameRequest* r) { r->mutable_spec()->mutable_view()->mutable_perspective(); }},
    {"spec.view.perspective.up", absl::StatusCode::kInvalidArgument, "parallel",
     [](v1::RenderFrameRequest* r) {
       auto* view = r->mutable_spec()->mutable_view()->mutable_perspective();
       view->mutable_eye()->mutable_at()->set_x(-50);
       view->mutable_target();
       view->mutable_up()->set_x(1);
     }},
    {"spec.view.perspective.target", absl::StatusCode::kInvalidArgument, "is the eye itself",
     [](v1::RenderFrameRequest* r) {
       auto* view = r->mutable_spec()->mutable_view()->mutable_perspective();
       view->mutable_eye();
       view->mutable_target();
     }},
    {"dataset", absl::StatusCode::kInvalidArgument, "empty",
     [](v1::RenderFrameRequest* r) { r->clear_dataset(); }},
    {"", absl::StatusCode::kOutOfRange, "steps 0 to 4",
     [](v1::RenderFrameRequest* r) { r->set_step(5); }},
    {"", absl::StatusCode::kOutOfRange, "18446744073709551615",
     [](v1::RenderFrameRequest* r) { r->set_step(~uint64_t{0}); }},
    {"", absl::StatusCode::kOutOfRange, "before the first",
     [](v1::RenderFrameRequest* r) { r->set_time_ns(std::numeric_limits<int64_t>::min()); }},
    {"", absl::StatusCode::kNotFound, "density",
     [](v1::RenderFrameRequest* r) { r->mutable_spec()->set_field("smoke"); }},
    {"", absl::StatusCode::kResourceExhausted, "33554432",
     [](v1::RenderFrameRequest* r) {
       r->mutable_spec()->set_encoding(v1::PNG);
       r->mutable_spec()->set_width_px(16384);
       r->mutable_spec()->set_height_px(16384);
     }},
};

TEST_F(MethodsTest, WrongRequestsGetTheirCodeAndNameTheirField) {
  for (const BadFrame& bad : kBadFrames) {
    v1::RenderFrameRequest request = Request();
    bad.spoil(&request);
    v1::Frame frame;
    const Status status = RenderFrame(request, &frame);
    EXPECT_THAT(status, FailsWith(bad.code, bad.text)) << bad.field;
    EXPECT_EQ(wire::FieldOf(status), bad.field) << MessageOf(status);
  }
  EXPECT_EQ(server_->frames_rendered(), 0U);
}

TEST_F(MethodsTest, RequestsAboveOneMebibyteAreRefused) {
  v1::RenderFrameRequest request = Request();
  request.set_dataset(std::string((1 << 20) + 1, 'x'));
  v1::Frame frame;
  EXPECT_EQ(RenderFrame(request, &frame).code(), absl::StatusCode::kResourceExhausted);
  request.set_dataset(std::string(1 << 19, 'x'));
  EXPECT_THAT(RenderFrame(request, &frame), FailsWith(absl::StatusCode::kNotFound, "xxx..."));
}

TEST_F(MethodsTest, ADeadlineThatHasPassedStopsWork) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now());
  v1::Frame frame;
  EXPECT_EQ(render_->RenderFrame(&context, Request(), &frame).error_code(),
            grpc::StatusCode::DEADLINE_EXCEEDED);
}

TEST_F(MethodsTest, HealthIsServed) {
  // grpc.health.v1: the request's field 1 is the service's name; the reply's is 1 for SERVING.
  for (const std::string service : {"", "fovea.v1.Render"}) {
    std::string reply;
    const std::string request =
        service.empty() ? "" : "\x0a" + std::string(1, static_cast<char>(service.size())) + service;
    ASSERT_TRUE(CallRaw("/grpc.health.v1.Health/Check", request, &reply).ok()) << service;
    EXPECT_EQ(reply, "\x08\x01") << service;
  }
}

TEST_F(MethodsTest, ReflectionNamesTheServices) {
  grpc::GenericStub stub(channel_);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareCall(
      &context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", &queue);
  const auto wait = [&] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  call->StartCall(nullptr);
  ASSERT_TRUE(wait());
  const grpc::Slice list_services(std::string("\x3a\x00", 2));  // field 7, an empty string
  call->Write(grpc::ByteBuffer(&list_services, 1), nullptr);
  ASSERT_TRUE(wait());
  grpc::ByteBuffer reply;
  call->Read(&reply, nullptr);
  ASSERT_TRUE(wait());
  grpc::Slice slice;
  ASSERT_TRUE(reply.DumpToSingleSlice(&slice).ok());
  const std::string bytes(reinterpret_cast<const char*>(slice.begin()), slice.size());
  EXPECT_THAT(bytes, HasSubstr("fovea.v1.Render"));
  EXPECT_THAT(bytes, HasSubstr("fovea.v1.Datasets"));
  context.TryCancel();
  queue.Shutdown();
}

TEST_F(MethodsTest, TwoServersCannotShareAPort) {
  ServerOptions options;
  options.root = Root();
  options.listen = server_->address();
  EXPECT_THAT(Server::Start(options),
              FailsWith(absl::StatusCode::kUnavailable, "cannot listen on 127.0.0.1:"));
}

TEST_F(MethodsTest, OnlyLoopbackUnlessToldOtherwise) {
  ServerOptions options;
  options.root = Root();
  for (const char* listen : {"0.0.0.0:0", "[::]:0", "example.org:0", "10.0.0.1:0"}) {
    options.listen = listen;
    EXPECT_THAT(Server::Start(options),
                FailsWith(absl::StatusCode::kInvalidArgument, "--insecure-plaintext"))
        << listen;
  }
  options.listen = "0.0.0.0:0";
  options.insecure_plaintext = true;
  EXPECT_OK(Server::Start(options).status());
  for (const char* listen : {"", "127.0.0.1", ":50051", "127.0.0.1:", "127.0.0.1:65536", "::1:5",
                             "127.0.0.1:-1", "127.0.0.1:5x"}) {
    options.listen = listen;
    EXPECT_THAT(Server::Start(options),
                FailsWith(absl::StatusCode::kInvalidArgument, "is not HOST:PORT"))
        << listen;
  }
}

class FullServerTest : public ServerFixture {};

TEST_F(FullServerTest, AFullQueueSaysSo) {
  StartServer(1, 1);
  v1::RenderFrameRequest request;
  request.set_dataset("plume");
  *request.mutable_spec() = SmallSpec(v1::PNG, 768);
  request.mutable_spec()->set_rate(64);
  struct Call {
    grpc::ClientContext context;
    v1::Frame frame;
    std::promise<Status> done;
  };
  std::vector<std::unique_ptr<Call>> calls;
  for (int i = 0; i < 24; ++i) {
    calls.push_back(std::make_unique<Call>());
    Call& call = *calls.back();
    render_->async()->RenderFrame(
        &call.context, &request, &call.frame,
        [&call](const grpc::Status& status) { call.done.set_value(wire::FromGrpc(status)); });
  }
  int served = 0;
  int refused = 0;
  for (const auto& call : calls) {
    const Status status = call->done.get_future().get();
    served += status.ok() ? 1 : 0;
    if (!status.ok()) {
      ++refused;
      EXPECT_THAT(status, FailsWith(absl::StatusCode::kResourceExhausted, "--render-queue 1"));
    }
  }
  EXPECT_GE(served, 1);
  EXPECT_GE(refused, 1);
}

}  // namespace
}  // namespace fovea::server
