#ifndef TESTS_UNIT_SERVICE_SERVER_SERVER_TEST_UTIL_H_
#define TESTS_UNIT_SERVICE_SERVER_SERVER_TEST_UTIL_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include "fovea/v1/datasets.grpc.pb.h"
#include "fovea/v1/render.grpc.pb.h"
#include "service/frames/frames.h"
#include "service/server/server.h"
#include "service/wire/convert.h"
#include "service/wire/status.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::server {

/// A server in this process, on a free port, over small stores: "plume" (5 steps of density) and
/// "lab/other" (1 step of density and heat).
class ServerFixture : public ::testing::Test {
 protected:
  static constexpr Int3 kDims{40, 36, 30};
  static constexpr int64_t kSteps = 5;

  void SetUp() override {
    std::filesystem::create_directories(Root() + "/lab");
    const store::DatasetInfo one = store::testing::MakeInfo(kDims, 16);
    const store::DatasetInfo two = store::testing::MakeInfo(kDims, 16, {"density", "heat"});
    ASSERT_OK(store::testing::MakeStore(Root() + "/plume.zarr", one, kSteps));
    ASSERT_OK(store::testing::MakeStore(Root() + "/lab/other.zarr", two, 1));
  }

  [[nodiscard]] std::string Root() const { return folder_.Path("root"); }

  void StartServer(int threads = 2, int render_queue = 64, const std::string& tokens = "") {
    ServerOptions options;
    options.root = Root();
    options.tokens = tokens;
    options.allow_ingest = allow_ingest_;
    if (keeps_jobs_) {
      std::filesystem::create_directories(folder_.Path("in"));
      std::filesystem::create_directories(folder_.Path("out"));
      options.state = folder_.Path("state");
      options.ingest_root = folder_.Path("in");
      options.export_root = folder_.Path("out");
    }
    options.memory_limit = memory_limit_;
    options.admin = admin_;
    options.reload_interval = std::chrono::milliseconds(10);
    options.listen = "127.0.0.1:0";
    options.threads = threads;
    options.render_queue = render_queue;
    options.rescan_interval = std::chrono::milliseconds(0);
    auto server = Server::Start(options);
    ASSERT_OK(server.status());
    server_ = *std::move(server);
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(wire::kMaxReplyMessageBytes);
    channel_ = grpc::CreateCustomChannel(server_->address(), grpc::InsecureChannelCredentials(),
                                         arguments);
    datasets_ = v1::Datasets::NewStub(channel_);
    render_ = v1::Render::NewStub(channel_);
  }

  /// A small picture of every kind of thing that can be left out or not.
  static v1::FrameSpec SmallSpec(v1::Encoding encoding = v1::RAW_RGBA_F32, uint32_t side = 48) {
    v1::FrameSpec spec;
    spec.set_encoding(encoding);
    spec.set_width_px(side);
    spec.set_height_px(side);
    spec.set_rate(12);
    spec.mutable_view()->mutable_orthographic()->set_azimuth_deg(30);
    spec.mutable_view()->mutable_orthographic()->set_elevation_deg(20);
    return spec;
  }

  /// What the server should send for `proto`, made in this process without it.
  static StatusOr<frames::Frame> InProcess(const std::string& path, int64_t step,
                                           const v1::FrameSpec& proto) {
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec spec, wire::FromProto(proto, "spec"));
    FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(path));
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, frames::DefaultSpec(*dataset));
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved,
                           frames::ResolveSpec(*dataset, spec, defaults));
    return frames::RenderFrame(*dataset, "in process", step, resolved, 1);
  }

  Status RenderFrame(const v1::RenderFrameRequest& request, v1::Frame* frame) {
    grpc::ClientContext context;
    return wire::FromGrpc(render_->RenderFrame(&context, request, frame));
  }
  Status Acknowledge(const std::string& stream_id, uint64_t index) {
    grpc::ClientContext context;
    v1::AcknowledgeRequest request;
    request.set_stream_id(stream_id);
    request.set_index(index);
    v1::AcknowledgeResponse response;
    return wire::FromGrpc(render_->Acknowledge(&context, request, &response));
  }

  /// Renders one frame. With one render thread, whatever was asked for before is done then.
  void Flush() {
    v1::RenderFrameRequest request;
    request.set_dataset("plume");
    *request.mutable_spec() = SmallSpec(v1::PNG, 16);
    v1::Frame frame;
    ASSERT_OK(RenderFrame(request, &frame));
  }

  std::string admin_;  // ServerOptions::admin of StartServer
  store::testing::TemporaryFolder folder_;
  // Of servers that are started from now on.
  bool allow_ingest_ = false;
  bool keeps_jobs_ = false;  // from files below "in" to files below "out" of folder_
  std::string memory_limit_ = "50%";
  std::unique_ptr<Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::Datasets::Stub> datasets_;
  std::unique_ptr<v1::Render::Stub> render_;
};

}  // namespace fovea::server

#endif  // TESTS_UNIT_SERVICE_SERVER_SERVER_TEST_UTIL_H_
