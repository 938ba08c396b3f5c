// The admin port, and whether what it counts is what was called.

#include <algorithm>
#include <future>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <string_view>
#include <thread>

#include <absl/strings/numbers.h>
#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <httplib.h>

#include "service/server/admin_server.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;

struct Reply {
  int status = 0;
  std::string body;
};

Reply Get(const std::string& address, const std::string& path) {
  httplib::Client client("http://" + address);
  const auto reply = client.Get(path.c_str());
  return reply ? Reply{reply->status, reply->body} : Reply{};
}

constexpr std::string_view kLowercase = "abcdefghijklmnopqrstuvwxyz_";

/// Takes `prefix` off the front of `text`; false if another thing stands there.
bool Take(std::string_view prefix, std::string_view* text) {
  const bool there = text->starts_with(prefix);
  text->remove_prefix(there ? prefix.size() : 0);
  return there;
}

/// Takes the letters of a name off the front of `text`; false if there are none.
bool TakeName(std::string_view* text) {
  const size_t end = std::min(text->find_first_not_of(kLowercase), text->size());
  text->remove_prefix(end);
  return end > 0;
}

/// Takes `{name="value",name="value"}` off the front, without escapes in values; false if another
/// thing stands there.
bool TakeLabels(std::string_view* text) {
  do {
    text->remove_prefix(1);  // { or ,
    if (!TakeName(text) || !Take("=\"", text)) {
      return false;
    }
    text->remove_prefix(std::min(text->find_first_of("\"\\"), text->size()));
    if (!Take("\"", text)) {
      return false;
    }
  } while (text->starts_with(','));
  return Take("}", text);
}

/// `name{labels} value`, the labels or not; nullopt if the line is anything else.
std::optional<std::pair<std::string, double>> ParseSample(std::string_view line) {
  std::string_view rest = line;
  if (!TakeName(&rest) || (rest.starts_with('{') && !TakeLabels(&rest))) {
    return std::nullopt;
  }
  const std::string_view name = line.substr(0, line.size() - rest.size());
  double value = 0;
  if (!Take(" ", &rest) ||
      (rest != "+Inf" && rest.find_first_not_of("-+0123456789.e") != std::string_view::npos) ||
      !absl::SimpleAtod({rest.data(), rest.size()}, &value)) {
    return std::nullopt;
  }
  return std::pair(std::string(name), value);
}

/// Prometheus' text format, read strictly: samples by name and labels as they stand. Every family
/// has help and a type before its samples, once, and every value is a number.
std::map<std::string, double> Parse(const std::string& text) {
  std::map<std::string, double> samples;
  std::set<std::string> families;
  std::string family;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("# HELP ")) {
      family = line.substr(7, line.find(' ', 7) - 7);
      EXPECT_TRUE(families.insert(family).second) << line;
    } else if (line.starts_with("# TYPE ")) {
      EXPECT_TRUE(line.starts_with("# TYPE " + family + " ")) << line;
    } else if (const auto sample = ParseSample(line)) {
      EXPECT_TRUE(sample->first.starts_with(family)) << line;
      EXPECT_TRUE(samples.insert(*sample).second) << line;
    } else {
      ADD_FAILURE() << "not in the format: " << line;
    }
  }
  return samples;
}

class AdminTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    admin_ = "127.0.0.1:0";
    StartServer();
  }

  std::map<std::string, double> Scrape() {
    const Reply reply = Get(server_->admin_address(), "/metrics");
    EXPECT_EQ(reply.status, 200);
    return Parse(reply.body);
  }

  static v1::RenderFrameRequest FrameOf(v1::Encoding encoding) {
    v1::RenderFrameRequest request;
    request.set_dataset("plume");
    *request.mutable_spec() = SmallSpec(encoding);
    return request;
  }

  static std::string Calls(const std::string& method, const std::string& code) {
    return "fovea_requests_total{code=\"" + code + "\",method=\"" + method + "\"}";
  }
};

constexpr char kRenderFrame[] = "fovea.v1.Render/RenderFrame";
constexpr char kRenderSequence[] = "fovea.v1.Render/RenderSequence";

TEST_F(AdminTest, CountsWhatWasCalled) {
  EXPECT_EQ(Scrape()["fovea_coefficients_total"], 0);
  v1::Frame frame;
  for (int i = 0; i < 3; ++i) {
    ASSERT_OK(RenderFrame(FrameOf(v1::RAW_RGBA8), &frame));
  }
  auto coefficients = static_cast<double>(3 * frame.stats().coefficients());
  ASSERT_OK(RenderFrame(FrameOf(v1::PNG), &frame));
  coefficients += static_cast<double>(frame.stats().coefficients());
  const auto png_bytes = static_cast<double>(frame.pixels().size());
  v1::RenderFrameRequest bad = FrameOf(v1::PNG);
  bad.mutable_spec()->set_rate(0);
  EXPECT_FALSE(RenderFrame(bad, &frame).ok());
  bad.set_dataset("nothing");
  bad.mutable_spec()->set_rate(1);
  EXPECT_FALSE(RenderFrame(bad, &frame).ok());

  grpc::ClientContext context;
  v1::RenderSequenceRequest sequence;
  sequence.set_dataset("plume");
  *sequence.mutable_spec() = SmallSpec(v1::RAW_RGBA_F32);
  const auto reader = render_->RenderSequence(&context, sequence);
  while (reader->Read(&frame)) {
    coefficients += static_cast<double>(frame.stats().coefficients());
  }
  ASSERT_TRUE(reader->Finish().ok());

  auto samples = Scrape();
  EXPECT_EQ(samples[Calls(kRenderFrame, "OK")], 4);
  EXPECT_EQ(samples[Calls(kRenderFrame, "INVALID_ARGUMENT")], 1);
  EXPECT_EQ(samples[Calls(kRenderFrame, "NOT_FOUND")], 1);
  EXPECT_EQ(samples[Calls(kRenderSequence, "OK")], 1);
  const auto by_method = [](const std::string& name, const std::string& method) {
    return name + "{method=\"" + method + "\"}";
  };
  EXPECT_EQ(samples[by_method("fovea_request_seconds_count", kRenderFrame)], 6);
  EXPECT_EQ(samples[by_method("fovea_frame_age_seconds_count", kRenderFrame)], 4);
  EXPECT_EQ(samples[by_method("fovea_frame_age_seconds_count", kRenderSequence)], kSteps);
  EXPECT_EQ(samples[by_method("fovea_requests_running", kRenderFrame)], 0);
  EXPECT_EQ(samples["fovea_frames_sent_total{encoding=\"RAW_RGBA8\"}"], 3);
  EXPECT_EQ(samples["fovea_frame_bytes_total{encoding=\"RAW_RGBA8\"}"], 3 * 48 * 48 * 4);
  EXPECT_EQ(samples["fovea_frame_bytes_total{encoding=\"PNG\"}"], png_bytes);
  EXPECT_EQ(samples["fovea_frame_bytes_total{encoding=\"RAW_RGBA_F32\"}"], kSteps * 48 * 48 * 16);
  EXPECT_EQ(samples["fovea_coefficients_total"], coefficients);
  EXPECT_EQ(samples["fovea_frames_rendered_total"], 4 + kSteps);
  EXPECT_EQ(samples["fovea_datasets"], 2);
  EXPECT_EQ(samples["fovea_connections_accepted_total"], 1);
  EXPECT_EQ(samples["fovea_connections_open"], 1);
  while (Scrape()["fovea_memory_used_bytes{part=\"replies\"}"] > 0) {  // until the last is gone
  }
  EXPECT_GT(samples["process_resident_memory_bytes"], 1 << 20);
}

TEST_F(AdminTest, RefusalsAreCountedByTheirReason) {
  v1::RenderFrameRequest large = FrameOf(v1::PNG);
  large.mutable_spec()->set_width_px(16384);
  large.mutable_spec()->set_height_px(16384);
  v1::Frame frame;
  EXPECT_EQ(RenderFrame(large, &frame).code(), absl::StatusCode::kResourceExhausted);
  auto samples = Scrape();
  EXPECT_EQ(samples["fovea_shed_total{reason=\"too_large\"}"], 1);
  EXPECT_EQ(samples["fovea_shed_total{reason=\"overload\"}"], 0);
}

TEST_F(AdminTest, BytesThatAreNoMessageAreTheClientsFault) {
  grpc::GenericStub stub(channel_);
  grpc::ClientContext context;
  const grpc::Slice bytes("\xFF\xFF\xFF");
  const grpc::ByteBuffer request(&bytes, 1);
  grpc::ByteBuffer response;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, "/fovea.v1.Render/RenderFrame", grpc::StubOptions(), &request, &response,
                 [&](grpc::Status status) { done.set_value(std::move(status)); });
  EXPECT_THAT(wire::FromGrpc(done.get_future().get()),
              FailsWith(absl::StatusCode::kInvalidArgument, "no message of this method"));
}

TEST_F(AdminTest, ClientsCannotMakeUpLabels) {
  grpc::GenericStub stub(channel_);
  for (const char* method : {"/fovea.v1.Render/Nothing", "/a\"b/c", "/x/y"}) {
    grpc::ClientContext context;
    const grpc::Slice bytes("");
    const grpc::ByteBuffer request(&bytes, 1);
    grpc::ByteBuffer response;
    std::promise<grpc::Status> done;
    stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &response,
                   [&](grpc::Status status) { done.set_value(std::move(status)); });
    EXPECT_EQ(done.get_future().get().error_code(), grpc::StatusCode::UNIMPLEMENTED);
  }
  const std::string text = Get(server_->admin_address(), "/metrics").body;
  EXPECT_THAT(text, ::testing::Not(HasSubstr("Nothing")));
  EXPECT_THAT(text, ::testing::Not(HasSubstr("x/y")));
}

TEST_F(AdminTest, EveryCallHasAnIdOfItsOwn) {
  std::set<std::string> ids;
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    v1::ListDatasetsResponse response;
    if (i % 2 == 0) {
      ASSERT_TRUE(datasets_->ListDatasets(&context, v1::ListDatasetsRequest(), &response).ok());
    } else {
      v1::Dataset dataset;
      EXPECT_FALSE(datasets_->GetDataset(&context, v1::GetDatasetRequest(), &dataset).ok());
    }
    const auto found = context.GetServerTrailingMetadata().find("fovea-request-id");
    ASSERT_NE(found, context.GetServerTrailingMetadata().end());
    ids.emplace(found->second.data(), found->second.size());
  }
  EXPECT_EQ(ids.size(), 20U);
  EXPECT_THAT(ids, ::testing::Each(::testing::MatchesRegex("[0-9a-f]{16}")));
}

TEST_F(AdminTest, IsReadyUntilItDrains) {
  const std::string address = server_->admin_address();
  EXPECT_EQ(Get(address, "/livez").status, 200);
  EXPECT_EQ(Get(address, "/readyz").status, 200);
  EXPECT_EQ(Get(address, "/nothing").status, 404);

  grpc::ClientContext context;
  v1::RenderSequenceRequest sequence;
  sequence.set_dataset("plume");
  sequence.set_window(1);
  sequence.set_stream_id("0123456789abcdef");
  *sequence.mutable_spec() = SmallSpec(v1::PNG);
  const auto reader = render_->RenderSequence(&context, sequence);
  v1::Frame frame;
  ASSERT_TRUE(reader->Read(&frame));  // and runs until it is acknowledged
  std::thread drain([&] { EXPECT_EQ(server_->Drain(std::chrono::seconds(60)), 0); });
  Reply ready;
  while ((ready = Get(address, "/readyz")).status == 200) {
  }
  EXPECT_EQ(ready.status, 503);
  EXPECT_EQ(ready.body, "draining\n");
  EXPECT_EQ(Get(address, "/livez").status, 200);
  EXPECT_EQ(Scrape()["fovea_draining"], 1);
  context.TryCancel();
  EXPECT_FALSE(reader->Finish().ok());
  drain.join();
  EXPECT_EQ(Get(address, "/readyz").status, 503);
  EXPECT_EQ(Get(address, "/metrics").status, 503);
}

TEST(AdminServerTest, IsNotReadyBeforeItIsTold) {
  auto admin = AdminServer::Start("127.0.0.1:0", false);
  ASSERT_OK(admin.status());
  const std::string address = (*admin)->address();
  EXPECT_EQ(Get(address, "/livez").status, 200);
  EXPECT_EQ(Get(address, "/readyz").status, 503);
  EXPECT_EQ(Get(address, "/readyz").body, "starting\n");
  EXPECT_EQ(Get(address, "/metrics").status, 503);
  (*admin)->SetState(AdminServer::State::kReady);
  EXPECT_EQ(Get(address, "/readyz").status, 200);
  EXPECT_THAT(AdminServer::Start(address, false),
              FailsWith(absl::StatusCode::kUnavailable, "the port is taken"));
}

TEST(AdminServerTest, OnlyLoopbackUnlessToldOtherwise) {
  EXPECT_THAT(AdminServer::Start("0.0.0.0:0", false),
              FailsWith(absl::StatusCode::kInvalidArgument, "--admin-any-address"));
  EXPECT_OK(AdminServer::Start("0.0.0.0:0", true).status());
  EXPECT_THAT(AdminServer::Start("127.0.0.1", false),
              FailsWith(absl::StatusCode::kInvalidArgument, "--admin: '127.0.0.1' is not"));
}

}  // namespace
}  // namespace fovea::server
