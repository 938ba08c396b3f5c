#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>

#include "fovea/v1/coefficients.grpc.pb.h"
#include "service/access/token_file.h"
#include "service/coefficients/plan.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

constexpr Int3 kOdd{70, 61, 53};

class CoefficientsTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    ASSERT_OK(
        store::testing::MakeStore(Root() + "/odd.zarr", store::testing::MakeInfo(kOdd, 16), 3));
  }

  void Start(const std::string& tokens = "") {
    StartServer(2, 64, tokens);
    coefficients_ = v1::Coefficients::NewStub(channel_);
  }

  static v1::StreamCoefficientsRequest Request(double rate = 70) {
    v1::StreamCoefficientsRequest request;
    request.set_dataset("odd");
    request.set_step(1);
    request.mutable_spec()->set_rate(rate);
    return request;
  }

  static v1::HeldCoefficients Held(uint64_t step, uint64_t content) {
    v1::HeldCoefficients held;
    held.set_step(step);
    held.mutable_fovea()->set_x(20);
    held.mutable_rate_xyz()->set_x(8);
    held.mutable_rate_xyz()->set_y(8);
    held.mutable_rate_xyz()->set_z(8);
    held.add_content(content);
    return held;
  }

  /// Reads the stream until `most` messages have come, and cancels it then.
  Status Read(const v1::StreamCoefficientsRequest& request, size_t most,
              std::vector<v1::CoefficientBlock>* blocks) {
    grpc::ClientContext context;
    const auto reader = coefficients_->StreamCoefficients(&context, request);
    v1::CoefficientBlock block;
    while (blocks->size() < most && reader->Read(&block)) {
      blocks->push_back(block);
    }
    if (blocks->size() == most) {
      context.TryCancel();
    }
    return wire::FromGrpc(reader->Finish());
  }
  Status Ask(const v1::StreamCoefficientsRequest& request) {
    std::vector<v1::CoefficientBlock> blocks;
    return Read(request, SIZE_MAX, &blocks);
  }

  /// What the server says of the values of a step.
  uint64_t ContentOf(uint64_t step) {
    v1::StreamCoefficientsRequest request = Request(4);
    request.set_step(step);
    std::vector<v1::CoefficientBlock> blocks;
    EXPECT_OK(Read(request, SIZE_MAX, &blocks));
    return blocks.at(0).set().fields(0).content();
  }

  std::unique_ptr<v1::Coefficients::Stub> coefficients_;
};

TEST_F(CoefficientsTest, AStreamThatWasCutGoesOnWhereItWas) {
  Start();
  std::vector<v1::CoefficientBlock> whole;
  ASSERT_OK(Read(Request(), SIZE_MAX, &whole));
  ASSERT_GE(whole.size(), 8U);
  EXPECT_TRUE(whole[0].has_set());
  EXPECT_EQ(whole[0].set().blocks(), whole.size());
  for (size_t i = 0; i < whole.size(); ++i) {
    EXPECT_EQ(whole[i].index(), i);
    EXPECT_EQ(whole[i].has_set(), i == 0);
    EXPECT_LE(whole[i].data().size(), coefficients::kMaxBlockBytes);
  }
  EXPECT_EQ(whole.back().rate_xyz().z(), 70);
  for (const size_t cut : {size_t{1}, whole.size() / 2, whole.size() - 1, whole.size()}) {
    std::vector<v1::CoefficientBlock> got;
    (void)Read(Request(), cut, &got);
    ASSERT_EQ(got.size(), cut);
    v1::StreamCoefficientsRequest rest = Request();
    rest.set_resume_token(got.back().resume_token());
    std::vector<v1::CoefficientBlock> more;
    ASSERT_OK(Read(rest, SIZE_MAX, &more));
    ASSERT_FALSE(more.empty());
    EXPECT_TRUE(more[0].has_set());
    if (cut == whole.size()) {
      ASSERT_EQ(more.size(), 1U);
      EXPECT_EQ(more[0].data(), "");
      EXPECT_EQ(more[0].rate_xyz().z(), 70);
      continue;
    }
    ASSERT_EQ(more.size(), whole.size() - cut);
    for (size_t i = 0; i < more.size(); ++i) {
      EXPECT_EQ(more[i].index(), cut + i);
      EXPECT_TRUE(more[i].data() == whole[cut + i].data());
      EXPECT_EQ(more[i].rate_xyz().x(), whole[cut + i].rate_xyz().x());
    }
  }
}

TEST_F(CoefficientsTest, ATokenIsOfOneRequest) {
  Start();
  std::vector<v1::CoefficientBlock> got;
  (void)Read(Request(), 2, &got);
  const std::string token = got.at(1).resume_token();
  const auto refused = [&](const std::function<void(v1::StreamCoefficientsRequest&)>& change) {
    v1::StreamCoefficientsRequest request = Request();
    request.set_resume_token(token);
    change(request);
    const Status status = Ask(request);
    EXPECT_EQ(wire::FieldOf(status), "resume_token") << MessageOf(status);
  };
  refused([](auto& request) { request.set_step(2); });
  refused([](auto& request) { request.mutable_spec()->set_rate(69); });
  refused([](auto& request) { request.mutable_spec()->mutable_fovea()->mutable_at()->set_x(1); });
  refused([&](auto& request) { *request.add_held() = Held(1, ContentOf(1)); });
  for (const std::string& bad :
       {std::string("x"), std::string("-"), token + "0", token.substr(0, token.size() - 1),
        token.substr(0, 17) + "99", token.substr(0, 17) + "-1", token.substr(0, 17) + "+1",
        std::string(65, 'a'), std::string("0-99999999999999999999")}) {
    refused([&](auto& request) { request.set_resume_token(bad); });
  }
}

TEST_F(CoefficientsTest, WrongRequestsAreRefusedByTheirFields) {
  Start();
  const auto field = [&](const std::function<void(v1::StreamCoefficientsRequest&)>& change) {
    v1::StreamCoefficientsRequest request = Request(8);
    change(request);
    const Status status = Ask(request);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << MessageOf(status);
    return wire::FieldOf(status);
  };
  const uint64_t content = ContentOf(1);
  const auto held = [&](const std::function<void(v1::HeldCoefficients&)>& change) {
    return [&, change](v1::StreamCoefficientsRequest& request) {
      *request.add_held() = Held(1, content);
      *request.add_held() = Held(1, content);
      change(*request.mutable_held(1));
    };
  };
  EXPECT_EQ(field([](auto& r) { r.set_dataset(""); }), "dataset");
  EXPECT_EQ(field([](auto& r) { r.mutable_spec()->set_rate(0.5); }), "spec.rate");
  EXPECT_EQ(field([](auto& r) { r.mutable_spec()->mutable_fovea()->mutable_at()->set_y(-1); }),
            "spec.fovea");
  EXPECT_EQ(field(held([](auto& h) { h.mutable_fovea()->set_x(std::nan("")); })), "held[1].fovea");
  EXPECT_EQ(field(held([](auto& h) { h.mutable_fovea()->set_x(70.5); })), "held[1].fovea");
  EXPECT_EQ(field(held([](auto& h) { h.mutable_rate_xyz()->set_y(0); })), "held[1].rate_xyz");
  EXPECT_EQ(field(held([](auto& h) { h.mutable_rate_xyz()->set_y(65537); })), "held[1].rate_xyz");
  EXPECT_EQ(field(held([](auto& h) { h.clear_content(); })), "held[1].content");
  EXPECT_EQ(field(held([](auto& h) { h.add_content(1); })), "held[1].content");
  EXPECT_EQ(field([&](auto& r) {
              *r.add_held() = Held(0, ContentOf(0));
              *r.add_held() = Held(2, ContentOf(2));
            }),
            "held[1].step");
  EXPECT_EQ(field([&](auto& r) {
              for (size_t i = 0; i <= coefficients::kMaxHeld; ++i) {
                *r.add_held() = Held(1, content);
              }
            }),
            "held");
  v1::StreamCoefficientsRequest request = Request(8);
  *request.add_held() = Held(3, content);
  EXPECT_THAT(Ask(request), FailsWith(absl::StatusCode::kOutOfRange, "step 3"));
  *request.mutable_held(0) = Held(1, content + 1);
  EXPECT_THAT(Ask(request), FailsWith(absl::StatusCode::kFailedPrecondition, "held[0].content"));
  *request.mutable_held(0) = Held(1, content);
  EXPECT_OK(Ask(request));
  request.set_time_ns(-5);
  EXPECT_THAT(Ask(request), FailsWith(absl::StatusCode::kOutOfRange, "time_ns"));
}

TEST_F(CoefficientsTest, ACancelledStreamLeavesNothingRunning) {
  Start();
  for (size_t most = 1; most < 6; ++most) {
    std::vector<v1::CoefficientBlock> got;
    EXPECT_THAT(Read(Request(), most, &got), FailsWith(absl::StatusCode::kCancelled, ""));
  }
  EXPECT_EQ(server_->Drain(std::chrono::seconds(20)), 0);
}

TEST_F(CoefficientsTest, QuotasCountACoefficientAsAPixel) {
  access::Token token;
  token.name = "slow";
  token.digest = access::DigestOf("secret");
  token.prefix = "odd";
  token.quotas.pixels_per_second = 200'000;
  const std::string file = folder_.Path("tokens.json");
  ASSERT_OK(access::WriteTokenFile(file, {token}));
  Start(file);
  EXPECT_THAT(Ask(Request()), FailsWith(absl::StatusCode::kUnauthenticated, ""));
  const auto as = [](grpc::ClientContext& context) {
    context.AddMetadata("authorization", "Bearer secret");
  };
  grpc::ClientContext context;
  as(context);
  const auto reader = coefficients_->StreamCoefficients(&context, Request());
  v1::CoefficientBlock block;
  int64_t blocks = 0;
  while (reader->Read(&block)) {
    ++blocks;
  }
  EXPECT_GT(blocks, 0);
  const Status status = wire::FromGrpc(reader->Finish());
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kResourceExhausted, "pixels"));
  EXPECT_TRUE(wire::RetryDelayOf(status).has_value());
  grpc::ClientContext outside;
  as(outside);
  v1::StreamCoefficientsRequest other = Request();
  other.set_dataset("plume");
  const auto unseen = coefficients_->StreamCoefficients(&outside, other);
  EXPECT_FALSE(unseen->Read(&block));
  EXPECT_THAT(wire::FromGrpc(unseen->Finish()), FailsWith(absl::StatusCode::kNotFound, "plume"));
}

}  // namespace
}  // namespace fovea::server
