#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <vector>

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>

#include "service/access/token_file.h"
#include "tests/unit/service/server/good_requests.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;

class TokensTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    access::Token writer = Entry("everything", "");
    writer.right = access::Right::kWrite;
    tokens_ = {writer, Entry("lab", "lab"), Entry("plume", "plume")};
    Write();
    StartServer(2, 64, File());
  }

  [[nodiscard]] std::string File() const { return folder_.Path("tokens.json"); }
  void Write() { ASSERT_OK(access::WriteTokenFile(File(), tokens_)); }
  /// The token of NAME is "secret-of-NAME".
  static access::Token Entry(const std::string& name, const std::string& prefix) {
    access::Token token;
    token.name = name;
    token.digest = access::DigestOf("secret-of-" + name);
    token.prefix = prefix;
    return token;
  }

  /// Tries again, for the server reads its files when it finds the time; not for ever.
  static void WaitUntil(const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!condition()) {
      ASSERT_LT(std::chrono::steady_clock::now(), end);
    }
  }

  static std::unique_ptr<grpc::ClientContext> As(const std::string& name) {
    auto context = std::make_unique<grpc::ClientContext>();
    context->set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    if (!name.empty()) {
      context->AddMetadata("authorization", "Bearer secret-of-" + name);
    }
    return context;
  }
  StatusOr<std::vector<std::string>> ListAs(const std::string& name, uint32_t page_size = 0) {
    std::vector<std::string> names;
    v1::ListDatasetsRequest request;
    request.set_page_size(page_size);
    do {
      v1::ListDatasetsResponse response;
      FOVEA_RETURN_IF_ERROR(
          wire::FromGrpc(datasets_->ListDatasets(As(name).get(), request, &response)));
      for (const auto& dataset : response.datasets()) {
        names.push_back(dataset.name());
      }
      request.set_page_token(response.next_page_token());
    } while (!request.page_token().empty());
    return names;
  }
  Status GetAs(const std::string& name, const std::string& dataset) {
    v1::GetDatasetRequest request;
    request.set_dataset(dataset);
    v1::Dataset response;
    return wire::FromGrpc(datasets_->GetDataset(As(name).get(), request, &response));
  }
  Status RenderAs(const std::string& name, const std::string& dataset) {
    v1::RenderFrameRequest request;
    request.set_dataset(dataset);
    *request.mutable_spec() = SmallSpec(v1::PNG, 32);
    v1::Frame frame;
    return wire::FromGrpc(render_->RenderFrame(As(name).get(), request, &frame));
  }
  Status AcknowledgeAs(const std::string& name, const std::string& stream_id) {
    v1::AcknowledgeRequest request;
    request.set_stream_id(stream_id);
    v1::AcknowledgeResponse response;
    return wire::FromGrpc(render_->Acknowledge(As(name).get(), request, &response));
  }
  static v1::RenderSequenceRequest Sequence(const std::string& stream_id) {
    v1::RenderSequenceRequest request;
    request.set_dataset("plume");
    *request.mutable_spec() = SmallSpec(v1::PNG, 32);
    request.set_window(1);
    request.set_stream_id(stream_id);
    return request;
  }

  std::vector<access::Token> tokens_;
};

/// A call by name with an empty request, without a token.
Status CallWithoutToken(const std::shared_ptr<grpc::Channel>& channel, const std::string& method) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  grpc::Slice empty;
  grpc::ByteBuffer request(&empty, 1);
  grpc::ByteBuffer response;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &response,
                 [&](grpc::Status status) { done.set_value(std::move(status)); });
  return wire::FromGrpc(done.get_future().get());
}

TEST_F(TokensTest, EveryMethodOfEveryServiceAsksForATokenFirst) {
  const auto methods = AllMethods();
  EXPECT_GE(methods.size(), 18U);
  for (const auto* method : methods) {
    const std::string path = "/" + method->service()->full_name() + "/" + method->name();
    EXPECT_THAT(CallWithoutToken(channel_, path),
                FailsWith(absl::StatusCode::kUnauthenticated, "asks for a token"))
        << path;
  }
}

TEST_F(TokensTest, AWrongTokenIsRefused) {
  EXPECT_THAT(GetAs("nobody", "plume"),
              FailsWith(absl::StatusCode::kUnauthenticated, "does not know"));
  EXPECT_THAT(ListAs("nobody"), FailsWith(absl::StatusCode::kUnauthenticated, "does not know"));
}

TEST_F(TokensTest, OutsideItsPrefixNothingIsThere) {
  EXPECT_THAT(*ListAs("everything"), ::testing::ElementsAre("lab/other", "plume"));
  EXPECT_THAT(*ListAs("everything", 1), ::testing::ElementsAre("lab/other", "plume"));
  EXPECT_THAT(*ListAs("lab", 1), ::testing::ElementsAre("lab/other"));
  EXPECT_THAT(*ListAs("plume"), ::testing::ElementsAre("plume"));
  EXPECT_OK(GetAs("lab", "lab/other"));
  EXPECT_OK(RenderAs("lab", "lab/other"));
  for (const char* dataset : {"plume", "nothing"}) {  // the one is there, the other is not
    const Status got = GetAs("lab", dataset);
    const Status rendered = RenderAs("lab", dataset);
    const Status nothing = GetAs("everything", "nothing");
    EXPECT_THAT(got, FailsWith(absl::StatusCode::kNotFound, dataset));
    EXPECT_EQ(got, rendered);
    EXPECT_EQ(RenderAs("everything", "nothing"), nothing);
    std::string message(MessageOf(got));
    message.replace(message.find(dataset), std::string(dataset).size(), "nothing");
    EXPECT_EQ(message, MessageOf(nothing));
  }
  const auto context = As("lab");
  const auto reader = render_->RenderSequence(context.get(), Sequence(""));
  EXPECT_THAT(wire::FromGrpc(reader->Finish()), FailsWith(absl::StatusCode::kNotFound, "plume"));
}

TEST_F(TokensTest, AnotherTokensStreamIsNotThere) {
  const std::string id = "0123456789abcdef";
  const auto context = As("plume");
  const auto reader = render_->RenderSequence(context.get(), Sequence(id));
  v1::Frame frame;
  ASSERT_TRUE(reader->Read(&frame));
  EXPECT_THAT(AcknowledgeAs("everything", id), FailsWith(absl::StatusCode::kNotFound, id.c_str()));
  const auto twin_context = As("everything");
  const auto twin = render_->RenderSequence(twin_context.get(), Sequence(id));
  EXPECT_TRUE(twin->Read(&frame));  // not ALREADY_EXISTS
  EXPECT_OK(AcknowledgeAs("plume", id));
  EXPECT_TRUE(reader->Read(&frame));
  context->TryCancel();
  twin_context->TryCancel();
  EXPECT_FALSE(reader->Finish().ok());
  EXPECT_FALSE(twin->Finish().ok());
}

TEST_F(TokensTest, QuotasAreHeldAndGivenBack) {
  tokens_[2].quotas = {.streams = 1, .pixels_per_second = 100};
  tokens_[1].quotas.bytes_in_per_second = 5;
  Write();
  // The debt is made. A call as the token that was before may fail in other ways.
  WaitUntil([&] { return absl::IsResourceExhausted(RenderAs("plume", "plume")); });
  const Status over = RenderAs("plume", "plume");
  EXPECT_THAT(over, FailsWith(absl::StatusCode::kResourceExhausted, "100 pixels a second"));
  EXPECT_TRUE(wire::RetryDelayOf(over).has_value());
  EXPECT_THAT(wire::DescribeDetails(over), HasSubstr("quota of token:plume"));

  const auto context = As("plume");
  const auto reader = render_->RenderSequence(context.get(), Sequence("0123456789abcdef"));
  v1::Frame frame;
  EXPECT_FALSE(reader->Read(&frame));
  EXPECT_THAT(wire::FromGrpc(reader->Finish()),
              FailsWith(absl::StatusCode::kResourceExhausted, "pixels a second"));

  EXPECT_OK(GetAs("lab", "lab/other"));
  EXPECT_THAT(GetAs("lab", "lab/other"),
              FailsWith(absl::StatusCode::kResourceExhausted, "5 bytes in a second"));
  EXPECT_OK(RenderAs("everything", "plume"));
}

// Of this quota one frame makes a debt of a quarter of an hour.
TEST_F(TokensTest, PixelsOfARefusedFrameAreGivenBack) {
  server_.reset();
  tokens_[1].quotas.pixels_per_second = 1;
  Write();
  memory_limit_ = "512MiB";
  StartServer(2, 64, File());
  v1::RenderFrameRequest request;
  request.set_dataset("lab/other");
  *request.mutable_spec() = SmallSpec(v1::PNG, 1700);
  v1::Frame frame;
  EXPECT_THAT(wire::FromGrpc(render_->RenderFrame(As("lab").get(), request, &frame)),
              FailsWith(absl::StatusCode::kResourceExhausted, "while it is worked on"));
  EXPECT_OK(RenderAs("lab", "lab/other"));
  EXPECT_THAT(RenderAs("lab", "lab/other"),
              FailsWith(absl::StatusCode::kResourceExhausted, "1 pixels a second"));
}

TEST_F(TokensTest, AcknowledgementsAreFree) {
  access::Token frugal = Entry("frugal", "plume");
  frugal.quotas.bytes_in_per_second = 0.01;
  tokens_.push_back(frugal);
  Write();
  const std::string id = "0123456789abcdef";
  v1::Frame frame;
  std::unique_ptr<grpc::ClientContext> context;
  std::unique_ptr<grpc::ClientReader<v1::Frame>> reader;
  WaitUntil([&] {
    context = As("frugal");
    reader = render_->RenderSequence(context.get(), Sequence(id));
    return reader->Read(&frame) || reader->Finish().ok();
  });
  EXPECT_THAT(GetAs("frugal", "plume"),
              FailsWith(absl::StatusCode::kResourceExhausted, "bytes in a second"));
  EXPECT_OK(AcknowledgeAs("frugal", id));
  EXPECT_TRUE(reader->Read(&frame));
  context->TryCancel();
  EXPECT_FALSE(reader->Finish().ok());
}

TEST_F(TokensTest, ATokenHasItsStreamsAtOnce) {
  access::Token one = Entry("one-stream", "plume");
  one.quotas.streams = 1;
  tokens_.push_back(one);
  Write();
  WaitUntil([&] { return GetAs("one-stream", "plume").ok(); });
  v1::Frame frame;
  const auto context = As("one-stream");
  const auto reader = render_->RenderSequence(context.get(), Sequence("0123456789abcdef"));
  ASSERT_TRUE(reader->Read(&frame));
  const auto more = As("one-stream");
  const auto refused = render_->RenderSequence(more.get(), Sequence("fedcba9876543210"));
  EXPECT_FALSE(refused->Read(&frame));
  EXPECT_THAT(wire::FromGrpc(refused->Finish()),
              FailsWith(absl::StatusCode::kResourceExhausted, "1 streams at once"));
  context->TryCancel();
  EXPECT_FALSE(reader->Finish().ok());
  WaitUntil([&] {  // the server knows of the cancel
    const auto next = As("one-stream");
    const auto opened = render_->RenderSequence(next.get(), Sequence("0123456789abcdef"));
    const bool has_frame = opened->Read(&frame);
    next->TryCancel();
    EXPECT_FALSE(opened->Finish().ok());
    return has_frame;
  });
}

TEST_F(TokensTest, ChangesOfTheFileAreTakenAndRubbishIsNot) {
  EXPECT_OK(RenderAs("lab", "lab/other"));
  tokens_.erase(tokens_.begin() + 1);
  tokens_.push_back(Entry("new", "plume"));
  Write();
  WaitUntil([&] { return RenderAs("new", "plume").ok(); });
  EXPECT_THAT(RenderAs("lab", "lab/other"),
              FailsWith(absl::StatusCode::kUnauthenticated, "does not know"));
  std::ofstream(File()) << "{\"tokens\": []";
  std::ofstream(File()) << "rubbish";
  std::filesystem::remove(File());
  for (int i = 0; i < 20; ++i) {
    EXPECT_OK(RenderAs("new", "plume"));
  }
}

TEST_F(TokensTest, TokensDoNotCrossANetworkInPlaintext) {
  ServerOptions options;
  options.root = Root();
  options.listen = "0.0.0.0:0";
  options.insecure_plaintext = true;
  options.tokens = File();
  EXPECT_THAT(Server::Start(options), FailsWith(absl::StatusCode::kInvalidArgument, "--tokens"));
  options.listen = "127.0.0.1:0";
  options.tokens = folder_.Path("none");
  EXPECT_THAT(Server::Start(options), FailsWith(absl::StatusCode::kNotFound, "none"));
}

}  // namespace
}  // namespace fovea::server
