#include "service/wire/status.h"

#include <string>

#include <gmock/gmock.h>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "tests/support/status_matchers.h"

namespace fovea::wire {
namespace {

using ::fovea::testing::FailsWith;
using std::chrono::milliseconds;

TEST(StatusTest, DetailsTravelAndSayWhatTheyMean) {
  const Status sent =
      WithRetry(WithQuota(ResourceExhausted("too much"), "token:lab", "10 pixels a second"),
                milliseconds(1500));
  const Status received = FromGrpc(ToGrpc(sent));
  EXPECT_EQ(received, sent);
  EXPECT_THAT(received, FailsWith(absl::StatusCode::kResourceExhausted, "too much"));
  EXPECT_EQ(RetryDelayOf(received), milliseconds(1500));
  EXPECT_EQ(DescribeDetails(received),
            "; quota of token:lab: 10 pixels a second; try again in 1.5 s");
  EXPECT_EQ(FieldOf(received), "");
  EXPECT_EQ(DescribeDetails(NotFound("x")), "");
}

TEST(StatusTest, AResourceIsNamedAsItWasAskedFor) {
  const grpc::Status sent = ToGrpc(WithResource(NotFound("no"), "fovea.v1.Dataset", "lab/a\nb"));
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(sent.error_details()));
  ASSERT_EQ(details.details_size(), 1);
  EXPECT_EQ(details.code(), 5);
  google::rpc::ResourceInfo resource;
  ASSERT_TRUE(details.details(0).UnpackTo(&resource));
  EXPECT_EQ(resource.resource_type(), "fovea.v1.Dataset");
  EXPECT_EQ(resource.resource_name(), "lab/a\\x0ab");
}

TEST(StatusTest, DetailsFromOutsideAreReadWithCare) {
  google::rpc::RetryInfo retry;
  retry.mutable_retry_delay()->set_seconds(-5);
  retry.mutable_retry_delay()->set_nanos(-7);
  google::rpc::Status details;
  details.add_details()->PackFrom(retry);
  auto* unknown = details.add_details();
  unknown->set_type_url("type.googleapis.com/google.rpc.Help");
  unknown->set_value("\xFF");
  const Status received =
      FromGrpc({grpc::StatusCode::RESOURCE_EXHAUSTED, "m", details.SerializeAsString()});
  EXPECT_EQ(RetryDelayOf(received), milliseconds(0));
  auto* broken = details.mutable_details(0);
  broken->set_value("\xFF\xFF");
  EXPECT_FALSE(
      RetryDelayOf(FromGrpc({grpc::StatusCode::UNKNOWN, "m", details.SerializeAsString()})));
  EXPECT_EQ(MessageOf(FromGrpc({grpc::StatusCode::UNKNOWN, "m", "rubbish"})), "m");
}

TEST(StatusTest, OtherWordsKeepTheDetails) {
  const Status status = WithMessage(BadField("spec.rate", "is 0"), "server x: is 0");
  EXPECT_EQ(MessageOf(status), "server x: is 0");
  EXPECT_EQ(FieldOf(status), "spec.rate");
}

}  // namespace
}  // namespace fovea::wire
