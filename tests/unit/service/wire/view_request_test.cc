#include "service/wire/view_request.h"

#include <string>

#include <gtest/gtest.h>
#include <malloc.h>

#include "tests/support/status_matchers.h"

namespace fovea::wire {
namespace {

using ::fovea::testing::FailsWith;

v1::ExploreRequest First() {
  v1::ExploreRequest request;
  request.set_dataset("plume");
  request.set_step(3);
  request.mutable_spec()->set_rate(20);
  request.mutable_spec()->set_width_px(64);
  request.mutable_spec()->mutable_transfer_function()->add_points()->set_opacity(0.5F);
  return request;
}

TEST(ExploreRequestsTest, WhatIsLeftOutStaysAsItWas) {
  ExploreRequests requests;
  ASSERT_OK(requests.Add(First()));
  v1::ExploreRequest next;
  next.mutable_spec()->set_width_px(32);
  next.mutable_spec()->mutable_transfer_function()->add_points()->set_opacity(0.25F);
  next.set_view_id(7);
  next.set_moving(true);
  const auto change = requests.Add(next);
  ASSERT_OK(change);
  ASSERT_TRUE(change->view);
  EXPECT_EQ(change->view->dataset, "plume");
  EXPECT_EQ(change->view->step, 3U);
  EXPECT_EQ(change->view->spec.rate, Rate(20));
  EXPECT_EQ(change->view->spec.width_px, 32);
  EXPECT_EQ(change->view->view_id, 7U);
  EXPECT_TRUE(change->view->moving);
  ASSERT_EQ(change->view->spec.transfer->points.size(), 1U) << "replaced, not appended to";
  EXPECT_FALSE(requests.Add({})->view->moving) << "of one request alone";
}

TEST(ExploreRequestsTest, ARateForEachAxisTakesThePlaceOfOneForAll) {
  ExploreRequests requests;
  ASSERT_OK(requests.Add(First()));
  v1::ExploreRequest next;
  next.mutable_spec()->mutable_rate_xyz()->set_x(10);
  next.mutable_spec()->mutable_rate_xyz()->set_y(20);
  next.mutable_spec()->mutable_rate_xyz()->set_z(30);
  const auto change = requests.Add(next);
  ASSERT_OK(change);
  EXPECT_EQ(change->view->spec.rate, Rate(10, 20, 30));
  next.Clear();
  next.mutable_spec()->set_rate(5);
  EXPECT_EQ(requests.Add(next)->view->spec.rate, Rate(5));
}

TEST(ExploreRequestsTest, ResetForgetsTheSpecAndNothingElse) {
  ExploreRequests requests;
  ASSERT_OK(requests.Add(First()));
  v1::ExploreRequest next;
  next.set_reset_spec(true);
  const auto change = requests.Add(next);
  ASSERT_OK(change);
  EXPECT_FALSE(change->view->spec.rate);
  EXPECT_EQ(change->view->step, 3U);
}

TEST(ExploreRequestsTest, AnAcknowledgementAloneIsNoView) {
  ExploreRequests requests;
  ASSERT_OK(requests.Add(First()));
  v1::ExploreRequest next;
  next.set_acknowledged(0);
  const auto change = requests.Add(next);
  ASSERT_OK(change);
  EXPECT_FALSE(change->view);
  EXPECT_EQ(change->acknowledged, 0U);
}

TEST(ExploreRequestsTest, WrongOnesNameTheField) {
  const auto fails = [](v1::ExploreRequest request, const std::string& field) {
    EXPECT_THAT(ExploreRequests().Add(request).status(),
                FailsWith(absl::StatusCode::kInvalidArgument, field));
  };
  fails({}, "dataset");
  v1::ExploreRequest request = First();
  request.set_window(65);
  fails(request, "window");
  for (const double ms : {0.0, -1.0, 10001.0, std::numeric_limits<double>::quiet_NaN()}) {
    request = First();
    request.set_frame_budget_ms(ms);
    fails(request, "frame_budget_ms");
    v1::RefineFrameRequest refine;
    refine.set_dataset("plume");
    refine.set_first_frame_ms(ms);
    EXPECT_THAT(FromProto(refine).status(),
                FailsWith(absl::StatusCode::kInvalidArgument, "first_frame_ms"));
  }
  request = First();
  request.mutable_spec()->set_rate(0);
  fails(request, "rate 0");
}

TEST(ExploreRequestsTest, KeepsNothingOfFieldsThatNobodyKnows) {
  v1::ExploreRequest request;
  request.set_dataset("plume");
  auto* spec = request.mutable_spec();
  spec->GetReflection()->MutableUnknownFields(spec)->AddLengthDelimited(
      999, std::string(size_t{256} << 10, 'x'));
  ExploreRequests requests;
  const size_t before = mallinfo2().uordblks;
  for (int i = 0; i < 40; ++i) {
    ASSERT_OK(requests.Add(request).status());
  }
  EXPECT_LT(mallinfo2().uordblks, before + (size_t{1} << 20));
}

}  // namespace
}  // namespace fovea::wire
