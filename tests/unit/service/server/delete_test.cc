// Datasets that are removed while they are served.

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>

#include "fovea/v1/ingest.grpc.pb.h"
#include "service/access/token_file.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;

class DeleteTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    allow_ingest_ = true;
  }

  Status Delete(const std::string& dataset, const std::string& token = "") {
    grpc::ClientContext context;
    if (!token.empty()) {
      context.AddMetadata("authorization", "Bearer " + token);
    }
    v1::DeleteDatasetRequest request;
    request.set_dataset(dataset);
    v1::DeleteDatasetResponse response;
    return wire::FromGrpc(datasets_->DeleteDataset(&context, request, &response));
  }
  Status Get(const std::string& dataset) {
    grpc::ClientContext context;
    v1::GetDatasetRequest request;
    request.set_dataset(dataset);
    v1::Dataset response;
    return wire::FromGrpc(datasets_->GetDataset(&context, request, &response));
  }
  [[nodiscard]] std::string Path(const std::string& name) const {
    return Root() + "/" + name + ".zarr";
  }
  /// Says all that would be chosen by the values, so that what is cached is found.
  static v1::FrameSpec Spec() {
    v1::FrameSpec spec = SmallSpec();
    spec.mutable_fovea()->mutable_at()->set_x(20);
    spec.mutable_fovea()->mutable_at()->set_y(18);
    spec.mutable_fovea()->mutable_at()->set_z(15);
    return spec;
  }
  /// The picture of step 0 of "plume".
  std::string Picture() {
    v1::RenderFrameRequest request;
    request.set_dataset("plume");
    *request.mutable_spec() = Spec();
    v1::Frame frame;
    EXPECT_OK(RenderFrame(request, &frame));
    return frame.pixels();
  }
  /// A store at `path`, of the fixture's dimensions, of which step 0 is other than its.
  static Status MakeOther(const std::string& path) {
    FOVEA_ASSIGN_OR_RETURN(const auto writer,
                           store::DatasetWriter::Create(path, store::testing::MakeInfo(kDims, 16)));
    const store::testing::StepData step = store::testing::MakeStep(kDims, 16, /*seed=*/77);
    FOVEA_RETURN_IF_ERROR(writer->WriteField("density", step.coefficients, step.stats));
    return writer->Commit(0, std::nullopt);
  }
  std::vector<std::string> EntriesOf(const std::string& folder) {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) {
      names.push_back(entry.path().filename().string());
    }
    return names;
  }
};

TEST_F(DeleteTest, RemovesItFromTheDisk) {
  StartServer();
  EXPECT_OK(Delete("lab/other"));
  EXPECT_THAT(Get("lab/other"), FailsWith(absl::StatusCode::kNotFound, "lab/other"));
  EXPECT_THAT(Delete("lab/other"), FailsWith(absl::StatusCode::kNotFound, "lab/other"));
  EXPECT_THAT(EntriesOf(Root() + "/lab"), ::testing::IsEmpty());
  EXPECT_OK(Get("plume"));
}

TEST_F(DeleteTest, OnlyWhoMayWriteRemoves) {
  allow_ingest_ = false;
  StartServer();
  EXPECT_THAT(Delete("plume"), FailsWith(absl::StatusCode::kPermissionDenied, "--allow-ingest"));
  access::Token reader;
  reader.name = "reader";
  reader.digest = access::DigestOf("r");
  access::Token lab;
  lab.name = "lab";
  lab.digest = access::DigestOf("l");
  lab.prefix = "lab";
  lab.right = access::Right::kWrite;
  ASSERT_OK(access::WriteTokenFile(folder_.Path("tokens.json"), {reader, lab}));
  StartServer(2, 64, folder_.Path("tokens.json"));
  EXPECT_THAT(Delete("plume", "r"), FailsWith(absl::StatusCode::kPermissionDenied, "reader"));
  EXPECT_THAT(Delete("plume", "l"), FailsWith(absl::StatusCode::kNotFound, "plume"));
  EXPECT_TRUE(fs::exists(Path("plume")));
  EXPECT_OK(Delete("lab/other", "l"));
}

TEST_F(DeleteTest, WhoeverWritesToItKeepsIt) {
  StartServer();
  {
    ASSERT_OK_AND_ASSIGN(const auto writer, store::DatasetWriter::Append(Path("plume")));
    EXPECT_THAT(Delete("plume"),
                FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
  }
  const auto ingest = v1::Ingest::NewStub(channel_);
  grpc::ClientContext context;
  const auto readings = ingest->StreamReadings(&context);
  v1::StreamReadingsRequest message;
  v1::ReadingsHeader& header = *message.mutable_header();
  header.set_dataset("live");
  header.set_step_seconds(1);
  header.mutable_lower();
  for (auto* vec : {header.mutable_upper(), header.mutable_voxel()}) {
    vec->set_x(1);
    vec->set_y(1);
    vec->set_z(1);
  }
  readings->Write(message);
  v1::StreamReadingsResponse ready;
  ASSERT_TRUE(readings->Read(&ready));
  EXPECT_THAT(Delete("live"),
              FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
  readings->WritesDone();
  while (readings->Read(&ready)) {
  }
  EXPECT_OK(wire::FromGrpc(readings->Finish()));
  EXPECT_OK(Delete("plume"));
}

TEST_F(DeleteTest, DamagedStoresGoAndForeignOnesStay) {
  StartServer();
  std::ofstream(Path("plume") + "/zarr.json") << "{ not json";
  EXPECT_THAT(Get("plume"), FailsWith(absl::StatusCode::kDataLoss, "plume"));
  EXPECT_OK(Delete("plume"));
  EXPECT_FALSE(fs::exists(Path("plume")));
  fs::create_directories(Path("foreign"));
  std::ofstream(Path("foreign") + "/zarr.json") << R"({"zarr_format": 3, "node_type": "group"})";
  EXPECT_THAT(Delete("foreign"), FailsWith(absl::StatusCode::kFailedPrecondition, "not removed"));
  fs::create_directory_symlink(Path("lab/other"), Path("link"));
  EXPECT_THAT(Delete("link"), FailsWith(absl::StatusCode::kFailedPrecondition, "symbolic link"));
  EXPECT_OK(Get("lab/other"));
  for (const char* name : {"../root/lab/other", "/etc", "lab"}) {
    EXPECT_THAT(Delete(name), FailsWith(absl::StatusCode::kNotFound, "")) << name;
  }
}

TEST_F(DeleteTest, StreamsInTheMiddleEndWithNotFound) {
  StartServer();
  grpc::ClientContext context;
  v1::RenderSequenceRequest request;
  request.set_dataset("plume");
  *request.mutable_spec() = SmallSpec(v1::PNG, 16);
  request.set_stream_id("0123456789abcdef");
  request.set_window(1);
  const auto frames = render_->RenderSequence(&context, request);
  v1::Frame frame;
  ASSERT_TRUE(frames->Read(&frame));
  EXPECT_OK(Delete("plume"));
  ASSERT_OK(MakeOther(Path("plume")));  // not a frame of this one, either
  EXPECT_OK(Acknowledge(request.stream_id(), 0));
  EXPECT_FALSE(frames->Read(&frame));
  EXPECT_THAT(wire::FromGrpc(frames->Finish()),
              FailsWith(absl::StatusCode::kNotFound, "removed or replaced"));
}

TEST_F(DeleteTest, ADatasetOfTheSameNameIsAnother) {
  StartServer();
  const std::string before = Picture();
  ASSERT_OK(MakeOther(folder_.Path("other.zarr")));
  ASSERT_OK_AND_ASSIGN(const frames::Frame other, InProcess(folder_.Path("other.zarr"), 0, Spec()));
  ASSERT_NE(before, other.pixels);
  EXPECT_OK(Delete("plume"));
  ASSERT_OK(MakeOther(Path("plume")));  // ext4 gives it the same inode, as a rule
  EXPECT_TRUE(Picture() == other.pixels);
}

TEST_F(DeleteTest, AFolderThatWasEmptiedAndUsedAgainIsAnother) {
  StartServer();
  const std::string before = Picture();
  ASSERT_OK(MakeOther(folder_.Path("other.zarr")));
  ASSERT_OK_AND_ASSIGN(const frames::Frame other, InProcess(folder_.Path("other.zarr"), 0, Spec()));
  for (const auto& entry : fs::directory_iterator(Path("plume"))) {
    fs::remove_all(entry.path());
  }
  ASSERT_OK(MakeOther(Path("plume")));  // in the very inode
  EXPECT_TRUE(Picture() == other.pixels);
}

TEST_F(DeleteTest, WhoWatchesIsTold) {
  StartServer();
  grpc::ClientContext context;
  v1::WatchDatasetRequest request;
  request.set_dataset("plume");
  const auto events = datasets_->WatchDataset(&context, request);
  v1::DatasetEvent event;
  ASSERT_TRUE(events->Read(&event));
  EXPECT_EQ(event.state(), v1::DatasetEvent::PRESENT);
  EXPECT_OK(Delete("plume"));
  ASSERT_TRUE(events->Read(&event));
  EXPECT_EQ(event.state(), v1::DatasetEvent::ABSENT);
  ASSERT_OK(MakeOther(Path("plume")));
  do {  // at first without its step
    ASSERT_TRUE(events->Read(&event));
  } while (event.committed_steps() == 0);
  EXPECT_EQ(event.committed_steps(), 1U);
  context.TryCancel();
}

TEST_F(DeleteTest, WhatAKilledServerLeftGoesAtTheNextStart) {
  const std::string left = Root() + "/lab/.fovea-removed-0";
  const std::string not_ours = Root() + "/lab/.fovea";
  fs::create_directories(not_ours);
  fs::rename(Path("plume"), left);
  allow_ingest_ = false;
  StartServer();
  EXPECT_OK(Get("lab/other"));
  EXPECT_TRUE(fs::exists(left));
  allow_ingest_ = true;
  StartServer();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (fs::exists(left) && std::chrono::steady_clock::now() < end) {
    std::this_thread::yield();
  }
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(fs::exists(not_ours));
  EXPECT_OK(Get("lab/other"));
}

}  // namespace
}  // namespace fovea::server
