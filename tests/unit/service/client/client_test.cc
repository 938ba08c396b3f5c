#include "service/client/client.h"

#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <mutex>
#include <vector>

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <netinet/in.h>

#include "service/access/token_file.h"
#include "service/frames/foveated_picture.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::client {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class ClientTest : public server::ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    StartServer();
    auto client = Client::Connect(server_->address());
    ASSERT_OK(client.status());
    client_ = *std::move(client);
  }

  static frames::FrameSpec Spec() { return *wire::FromProto(SmallSpec(), "spec"); }

  std::unique_ptr<Client> client_;
};

TEST_F(ClientTest, ListsAndDescribesDatasets) {
  ASSERT_OK_AND_ASSIGN(const auto datasets, client_->ListDatasets());
  ASSERT_EQ(datasets.size(), 2U);
  EXPECT_EQ(datasets[1].name, "plume");
  EXPECT_EQ(datasets[1].info.committed_steps, 5);
  ASSERT_OK_AND_ASSIGN(const DatasetSummary plume, client_->GetDataset("plume"));
  EXPECT_EQ(plume.info.hierarchy.dims(), kDims);
  EXPECT_EQ(plume.default_spec.field, "density");
  EXPECT_TRUE(plume.default_spec.transfer.has_value());
}

TEST_F(ClientTest, AFrameIsTheSameAsInProcess) {
  ASSERT_OK_AND_ASSIGN(const frames::Frame frame, client_->RenderFrame("plume", 2, Spec()));
  ASSERT_OK_AND_ASSIGN(const frames::Frame expected,
                       InProcess(Root() + "/plume.zarr", 2, SmallSpec()));
  EXPECT_TRUE(frame.pixels == expected.pixels);
  EXPECT_EQ(frame.used, expected.used);
  EXPECT_EQ(frame.time_ns, expected.time_ns);
  EXPECT_EQ(frame.stats.coefficients, expected.stats.coefficients);
}

TEST_F(ClientTest, APlanIsWhatTheFrameThenCosts) {
  ASSERT_OK_AND_ASSIGN(const frames::FramePlan plan, client_->PlanFrame("plume", 2, Spec(), {}));
  ASSERT_OK_AND_ASSIGN(const frames::Frame frame, client_->RenderFrame("plume", 2, Spec()));
  EXPECT_EQ(plan.used, frame.used);
  EXPECT_EQ(plan.coefficients, frame.stats.coefficients);
  EXPECT_EQ(plan.bytes_read, frame.stats.bytes_read);
  frames::FrameSpec spec = Spec();
  spec.rate.reset();
  frames::FrameBudget budget;
  const auto rate = [&] {  // 0: none
    const auto within = client_->PlanFrame("plume", 2, spec, budget);
    return within.ok() ? within->used.rate->x : 0;
  };
  budget.ms = 1e6;
  EXPECT_EQ(rate(), 40);  // all
  budget.coefficients = plan.coefficients;
  EXPECT_EQ(rate(), 12);
  budget.bytes_read = plan.bytes_read - 1;
  EXPECT_LT(rate(), 12);
  budget = {};
  budget.memory_bytes = plan.counts.memory_bytes;
  EXPECT_GE(rate(), 12);
  EXPECT_LT(rate(), 40);
  budget.coefficients = 1;
  EXPECT_THAT(client_->PlanFrame("plume", 2, spec, budget),
              FailsWith(absl::StatusCode::kResourceExhausted, "at rate 1"));
  EXPECT_THAT(client_->PlanFrame("nothing", 2, {}, {}),
              FailsWith(absl::StatusCode::kNotFound, "'nothing'"));
}

TEST_F(ClientTest, FoveatedFramesOfASequenceExpandToItsPictures) {
  SequenceRequest request;
  request.dataset = "plume";
  request.spec = Spec();
  const auto pictures = [&](frames::Encoding encoding) {
    std::vector<frames::Frame> got;
    request.spec.encoding = encoding;
    EXPECT_OK(client_->RenderSequence(request, [&](const frames::Frame& frame) {
      got.push_back(frame);
      return true;
    }));
    return got;
  };
  const auto foveated = pictures(frames::Encoding::kFoveated);
  const auto expected = pictures(frames::Encoding::kRawRgba8);
  ASSERT_EQ(foveated.size(), 5U);
  ASSERT_EQ(expected.size(), 5U);
  for (size_t i = 0; i < expected.size(); ++i) {
    ASSERT_OK_AND_ASSIGN(const frames::Frame expanded,
                         frames::ExpandFrame(foveated[i], frames::Encoding::kRawRgba8));
    EXPECT_TRUE(expanded.pixels == expected[i].pixels) << i;
    EXPECT_EQ(expanded.used, expected[i].used);
  }
}

TEST_F(ClientTest, ASequenceComesInOrderWithAnyWindow) {
  for (const uint32_t window : {0U, 1U, 2U, 64U}) {
    SequenceRequest request;
    request.dataset = "plume";
    request.spec = Spec();
    request.window = window;
    std::vector<int64_t> steps;
    ASSERT_OK(client_->RenderSequence(request, [&](const frames::Frame& frame) {
      EXPECT_EQ(frame.index, steps.size());
      steps.push_back(frame.step);
      return true;
    }));
    EXPECT_THAT(steps, ::testing::ElementsAre(0, 1, 2, 3, 4)) << window;
  }
}

TEST_F(ClientTest, ASequenceCanBeResumedAndStopped) {
  SequenceRequest request;
  request.dataset = "plume";
  request.first = 0;
  request.last = 4;
  request.stride = 2;
  request.start_index = 1;
  request.spec = Spec();
  std::vector<int64_t> steps;
  ASSERT_OK(client_->RenderSequence(request, [&](const frames::Frame& frame) {
    steps.push_back(frame.step);
    return false;
  }));
  EXPECT_THAT(steps, ::testing::ElementsAre(2));
}

TEST_F(ClientTest, ErrorsAreTheServersAndSayWhich) {
  const auto missing = client_->GetDataset("nothing");
  EXPECT_THAT(missing, FailsWith(absl::StatusCode::kNotFound, "'nothing'"));
  EXPECT_THAT(std::string(MessageOf(missing.status())),
              StartsWith("server " + server_->address() + ": "));
  EXPECT_THAT(client_->RenderFrame("plume", 99, {}),
              FailsWith(absl::StatusCode::kOutOfRange, "steps 0 to 4"));
  frames::FrameSpec outside;
  outside.fovea = frames::Position{{100, 0, 0}};
  const auto result = client_->RenderFrame("plume", 0, outside);
  EXPECT_EQ(wire::FieldOf(result.status()), "spec.fovea");
}

/// A server that asks for tokens, with one of the name "lab" in TokenFile().
class TokenClientTest : public server::ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    access::Token token;
    token.name = "lab";
    token.digest = access::DigestOf("secret");
    token.quotas.pixels_per_second = 4000;
    ASSERT_OK(access::WriteTokenFile(folder_.Path("tokens.json"), {token}));
    std::ofstream(TokenFile()) << " secret\r\n";
    StartServer(2, 64, folder_.Path("tokens.json"));
  }
  [[nodiscard]] std::string TokenFile() const { return folder_.Path("lab.token"); }
  [[nodiscard]] Credentials Lab() const { return {.token_file = TokenFile()}; }
};

TEST_F(TokenClientTest, EveryCallCarriesTheToken) {
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(server_->address(), Lab()));
  EXPECT_OK(client->ListDatasets().status());
  EXPECT_OK(client->GetDataset("plume").status());
  EXPECT_OK(client->RenderFrame("plume", 0, *wire::FromProto(SmallSpec(), "spec")).status());
  ASSERT_OK_AND_ASSIGN(const auto other, Client::Connect(server_->address()));
  EXPECT_THAT(other->ListDatasets(), FailsWith(absl::StatusCode::kUnauthenticated, "--token-file"));
}

TEST_F(TokenClientTest, AStreamAboveItsQuotaGoesOnWhenItMay) {
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(server_->address(), Lab()));
  SequenceRequest request;
  request.dataset = "plume";
  request.spec = *wire::FromProto(SmallSpec(), "spec");  // 2,304 pixels a frame
  std::vector<int64_t> steps;
  const auto begin = std::chrono::steady_clock::now();
  ASSERT_OK(client->RenderSequence(request, [&](const frames::Frame& frame) {
    steps.push_back(frame.step);
    return true;
  }));
  EXPECT_THAT(steps, ::testing::ElementsAre(0, 1, 2, 3, 4));
  // The last may be in debt: four are paid for, at 4,000 a second with 4,000 in hand.
  EXPECT_GT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(1300));
  const auto over = client->RenderFrame("plume", 0, request.spec);
  EXPECT_THAT(over, FailsWith(absl::StatusCode::kResourceExhausted, "quota of token:lab"));
  EXPECT_THAT(over, FailsWith(absl::StatusCode::kResourceExhausted, "; try again in "));
}

TEST_F(TokenClientTest, CredentialsThatDoNotGoTogether) {
  const auto fails = [](const std::string& address, const Credentials& credentials,
                        absl::StatusCode code, const char* text) {
    EXPECT_THAT(Client::Connect(address, credentials).status(), FailsWith(code, text));
  };
  const std::string here = "127.0.0.1:1";
  const std::string file = TokenFile();
  fails("192.0.2.1:1", Lab(), absl::StatusCode::kInvalidArgument, "plaintext");
  fails("example.org:1", Lab(), absl::StatusCode::kInvalidArgument, "plaintext");
  fails(here, {.ca_file = file, .cert_file = file}, absl::StatusCode::kInvalidArgument, "both");
  fails(here, {.cert_file = file, .key_file = file}, absl::StatusCode::kInvalidArgument,
        "--tls-ca");
  fails(here, {.ca_file = file}, absl::StatusCode::kInvalidArgument, "no certificate");
  fails(here, {.ca_file = "none"}, absl::StatusCode::kNotFound, "--tls-ca");
  fails(here, {.token_file = "none"}, absl::StatusCode::kNotFound, "--token-file");
  std::ofstream(file) << "two words";
  fails(here, Lab(), absl::StatusCode::kInvalidArgument, "--token-file");
}

TEST_F(ClientTest, WhatIsWrongBeforehandIsNotSent) {
  frames::FrameSpec bad;
  bad.width_px = int64_t{1} << 40;
  EXPECT_THAT(client_->RenderFrame("plume", 0, bad),
              FailsWith(absl::StatusCode::kInvalidArgument, "width_px"));
  EXPECT_THAT(client_->RenderFrame("plume", -1, {}),
              FailsWith(absl::StatusCode::kInvalidArgument, "step -1"));
  const auto never = [](const frames::Frame&) { return true; };
  SequenceRequest request;
  request.dataset = "plume";
  request.stride = 0;
  EXPECT_THAT(client_->RenderSequence(request, never),
              FailsWith(absl::StatusCode::kInvalidArgument, "stride"));
  request.stride = 1;
  request.first = 3;
  request.last = 2;
  EXPECT_THAT(client_->RenderSequence(request, never),
              FailsWith(absl::StatusCode::kInvalidArgument, "before the first"));
}

/// A socket of this machine that is bound, and listens or not, but never answers.
class SilentSocket {
 public:
  explicit SilentSocket(bool listening) : descriptor_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    EXPECT_EQ(bind(descriptor_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    if (listening) {
      EXPECT_EQ(listen(descriptor_, 8), 0);
    }
    address_ = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  }
  ~SilentSocket() { close(descriptor_); }
  [[nodiscard]] const std::string& address() const { return address_; }

 private:
  int descriptor_;
  std::string address_;
};

TEST(ClientErrorTest, NobodyListens) {
  const SilentSocket socket(false);
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(socket.address()));
  const auto result = client->ListDatasets();
  EXPECT_THAT(result, FailsWith(absl::StatusCode::kUnavailable, "`fovea serve ROOT` starts"));
  EXPECT_THAT(std::string(MessageOf(result.status())), HasSubstr(socket.address()));
  SequenceRequest request;
  request.dataset = "plume";
  EXPECT_THAT(client->RenderSequence(request, [](const frames::Frame&) { return true; }),
              FailsWith(absl::StatusCode::kUnavailable, socket.address()));
}

TEST(ClientErrorTest, NobodyAnswers) {
  const SilentSocket socket(true);
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(socket.address(), {}, 0.2));
  EXPECT_THAT(client->GetDataset("plume"),
              FailsWith(absl::StatusCode::kDeadlineExceeded, socket.address()));
  SequenceRequest request;
  request.dataset = "plume";
  EXPECT_THAT(client->RenderSequence(request, [](const frames::Frame&) { return true; }),
              FailsWith(absl::StatusCode::kDeadlineExceeded, "no frame came within 0.2 s"));
}

TEST(ClientErrorTest, AddressesAreHostAndPort) {
  for (const char* address : {"", "localhost", "127.0.0.1:0", "127.0.0.1:99999", ":1", "a:b:1"}) {
    EXPECT_EQ(Client::Connect(address).status().code(), absl::StatusCode::kInvalidArgument)
        << address;
  }
}

/// A server that does what a test tells it to.
class FakeRender final : public v1::Render::Service {
 public:
  using Answer = std::function<grpc::Status(const v1::RenderSequenceRequest& request,
                                            grpc::ServerWriter<v1::Frame>* writer)>;

  FakeRender() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }
  [[nodiscard]] const std::string& address() const { return address_; }
  void set_frame(v1::Frame frame) { frame_ = std::move(frame); }
  void set_answer(Answer answer) { answer_ = std::move(answer); }

  grpc::Status RenderFrame(grpc::ServerContext* /*context*/,
                           const v1::RenderFrameRequest* /*request*/, v1::Frame* frame) override {
    *frame = frame_;
    return grpc::Status::OK;
  }
  grpc::Status RenderSequence(grpc::ServerContext* /*context*/,
                              const v1::RenderSequenceRequest* request,
                              grpc::ServerWriter<v1::Frame>* writer) override {
    return answer_(*request, writer);
  }

  /// Two by two pixels.
  static v1::Frame Frame(uint64_t index) {
    v1::Frame frame;
    frame.set_encoding(v1::RAW_RGBA8);
    frame.set_width_px(2);
    frame.set_height_px(2);
    frame.set_pixels(std::string(16, 'p'));
    frame.set_index(index);
    frame.mutable_used()->set_rate(77);
    return frame;
  }

 private:
  std::string address_;
  v1::Frame frame_;
  Answer answer_;
  std::unique_ptr<grpc::Server> server_;
};

TEST(ClientCheckTest, AFrameThatCannotBeIsNotPassedOn) {
  FakeRender fake;
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(fake.address()));
  v1::Frame frame = FakeRender::Frame(0);
  fake.set_frame(frame);
  EXPECT_OK(client->RenderFrame("plume", 0, {}).status());
  frame.mutable_pixels()->resize(15);
  fake.set_frame(frame);
  EXPECT_THAT(client->RenderFrame("plume", 0, {}),
              FailsWith(absl::StatusCode::kInternal, "15 bytes"));
  fake.set_frame(FakeRender::Frame(3));
  EXPECT_THAT(client->RenderFrame("plume", 0, {}),
              FailsWith(absl::StatusCode::kInternal, "frame 3 came where 0 was due"));
}

TEST(ClientCheckTest, ALostStreamGoesOnWhereItWas) {
  FakeRender fake;
  std::mutex mutex;
  std::vector<v1::RenderSequenceRequest> requests;
  fake.set_answer(
      [&](const v1::RenderSequenceRequest& request, grpc::ServerWriter<v1::Frame>* writer) {
        const std::lock_guard lock(mutex);
        requests.push_back(request);
        const uint64_t end = std::min<uint64_t>(request.start_index() + 2, 5);
        for (uint64_t i = request.start_index(); i < end; ++i) {
          writer->Write(FakeRender::Frame(i));
        }
        return end == 5 ? grpc::Status::OK : grpc::Status(grpc::StatusCode::UNAVAILABLE, "gone");
      });
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(fake.address()));
  SequenceRequest request;
  request.dataset = "plume";
  uint64_t next = 0;
  ASSERT_OK(client->RenderSequence(request, [&](const frames::Frame& frame) {
    EXPECT_EQ(frame.index, next++);
    return true;
  }));
  EXPECT_EQ(next, 5U);
  ASSERT_EQ(requests.size(), 3U);
  EXPECT_EQ(requests[0].spec().rate(), 0);
  EXPECT_EQ(requests[2].start_index(), 4U);
  EXPECT_EQ(requests[2].spec().rate(), 77);  // as what came before
  EXPECT_NE(requests[0].stream_id(), requests[1].stream_id());
}

TEST(ClientCheckTest, ALostPathGoesOnAlongItself) {
  FakeRender fake;
  std::vector<v1::RenderSequenceRequest> requests;
  fake.set_answer(
      [&](const v1::RenderSequenceRequest& request, grpc::ServerWriter<v1::Frame>* writer) {
        requests.push_back(request);
        v1::Frame frame = FakeRender::Frame(request.start_index());
        frame.mutable_used()->mutable_view()->mutable_perspective()->mutable_up()->set_z(1);
        frame.mutable_used()->mutable_view()->mutable_perspective()->mutable_eye();
        writer->Write(frame);
        return request.start_index() == 1 ? grpc::Status::OK
                                          : grpc::Status(grpc::StatusCode::UNAVAILABLE, "gone");
      });
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(fake.address()));
  SequenceRequest request;
  request.dataset = "plume";
  frames::Keyframe key;
  key.eye = Vec3{1, 2, 3};
  ASSERT_OK_AND_ASSIGN(request.path, frames::Animation::Make(2, {key}));
  ASSERT_OK(client->RenderSequence(request, [](const frames::Frame&) { return true; }));
  ASSERT_EQ(requests.size(), 2U);
  EXPECT_EQ(requests[1].path().SerializeAsString(), requests[0].path().SerializeAsString());
  EXPECT_EQ(requests[1].path().keys(0).eye().y(), 2);
  EXPECT_EQ(requests[1].spec().rate(), 77);  // as what came before, but for the view:
  EXPECT_EQ(requests[1].spec().view().projection_case(),
            requests[0].spec().view().projection_case());
}

TEST(ClientCheckTest, AServerThatIsGoneForGoodIsNotAskedForEver) {
  FakeRender fake;
  std::atomic<int> calls = 0;
  fake.set_answer(
      [&](const v1::RenderSequenceRequest& request, grpc::ServerWriter<v1::Frame>* writer) {
        if (++calls == 1) {
          writer->Write(FakeRender::Frame(request.start_index()));
        }
        return grpc::Status(grpc::StatusCode::UNAVAILABLE, "gone");
      });
  ASSERT_OK_AND_ASSIGN(const auto client, Client::Connect(fake.address()));
  SequenceRequest request;
  request.dataset = "plume";
  EXPECT_THAT(client->RenderSequence(request, [](const frames::Frame&) { return true; }),
              FailsWith(absl::StatusCode::kUnavailable, "gone"));
  EXPECT_EQ(calls, 2);
}

}  // namespace
}  // namespace fovea::client
