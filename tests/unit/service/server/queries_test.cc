#include <numeric>

#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

class QueriesTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    StartServer();
  }
  Status Plan(const v1::PlanFrameRequest& request, v1::FramePlan* plan) {
    grpc::ClientContext context;
    return wire::FromGrpc(render_->PlanFrame(&context, request, plan));
  }
  Status Count(const v1::GetHistogramRequest& request, v1::Histogram* histogram) {
    grpc::ClientContext context;
    return wire::FromGrpc(datasets_->GetHistogram(&context, request, histogram));
  }
  static v1::PlanFrameRequest PlanRequest() {
    v1::PlanFrameRequest request;
    request.set_dataset("plume");
    request.set_step(3);
    *request.mutable_spec() = SmallSpec();
    return request;
  }
};

TEST_F(QueriesTest, APlanCountsWhatTheFrameThenCosts) {
  v1::FramePlan plan;
  ASSERT_OK(Plan(PlanRequest(), &plan));
  v1::RenderFrameRequest request;
  request.set_dataset("plume");
  request.set_step(3);
  *request.mutable_spec() = plan.used();
  v1::Frame frame;
  ASSERT_OK(RenderFrame(request, &frame));
  EXPECT_EQ(plan.step(), 3U);
  EXPECT_EQ(plan.coefficients(), frame.stats().coefficients());
  EXPECT_EQ(plan.super_voxels(), frame.stats().super_voxels());
  EXPECT_EQ(plan.samples(), frame.stats().samples());
  EXPECT_EQ(plan.chunks_read(), frame.stats().chunks_read());
  EXPECT_EQ(plan.chunks_total(), frame.stats().chunks_total());
  EXPECT_EQ(plan.bytes_read(), frame.stats().bytes_read());
  EXPECT_GT(plan.total_ms(), 0);
}

TEST_F(QueriesTest, ABudgetGivesTheLargestRateWithinIt) {
  v1::FramePlan whole;
  ASSERT_OK(Plan(PlanRequest(), &whole));
  v1::PlanFrameRequest request = PlanRequest();
  request.mutable_budget()->set_coefficients(whole.coefficients() / 2);
  v1::FramePlan plan;
  ASSERT_OK(Plan(request, &plan));
  EXPECT_LE(plan.coefficients(), whole.coefficients() / 2);
  EXPECT_LT(plan.used().rate(), whole.used().rate());
  request.mutable_budget()->set_coefficients(1);
  EXPECT_EQ(Plan(request, &plan).code(), absl::StatusCode::kResourceExhausted);
}

TEST_F(QueriesTest, WrongPlansNameTheField) {
  v1::FramePlan plan;
  v1::PlanFrameRequest request = PlanRequest();
  request.mutable_budget()->set_total_ms(-1);
  EXPECT_THAT(Plan(request, &plan),
              FailsWith(absl::StatusCode::kInvalidArgument, "budget.total_ms"));
  request = PlanRequest();
  request.mutable_budget()->set_bytes_read(0);
  EXPECT_THAT(Plan(request, &plan),
              FailsWith(absl::StatusCode::kInvalidArgument, "budget.bytes_read"));
  request = PlanRequest();
  request.set_step(5);
  EXPECT_THAT(Plan(request, &plan), FailsWith(absl::StatusCode::kOutOfRange, "step 5"));
}

TEST_F(QueriesTest, AHistogramCountsEveryVoxel) {
  v1::GetHistogramRequest request;
  request.set_dataset("lab/other");
  request.set_field("heat");
  v1::Histogram histogram;
  ASSERT_OK(Count(request, &histogram));
  EXPECT_EQ(histogram.field(), "heat");
  EXPECT_LT(histogram.minimum(), histogram.maximum());
  ASSERT_EQ(histogram.counts_size(), 256);
  EXPECT_EQ(std::accumulate(histogram.counts().begin(), histogram.counts().end(), uint64_t{0}),
            static_cast<uint64_t>(kDims.x * kDims.y * kDims.z));
  request.clear_field();
  ASSERT_OK(Count(request, &histogram));
  EXPECT_EQ(histogram.field(), "density");
  request.set_field("pressure");
  EXPECT_THAT(Count(request, &histogram), FailsWith(absl::StatusCode::kNotFound, "pressure"));
  request.clear_field();
  request.set_step(1);
  EXPECT_THAT(Count(request, &histogram), FailsWith(absl::StatusCode::kOutOfRange, "step 1"));
  EXPECT_THAT(Count({}, &histogram), FailsWith(absl::StatusCode::kInvalidArgument, "dataset"));
}

}  // namespace
}  // namespace fovea::server
