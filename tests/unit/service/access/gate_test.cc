#include "service/access/gate.h"

#include <fstream>

#include <gtest/gtest.h>

#include "service/access/token_file.h"
#include "service/wire/status.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::access {
namespace {

using ::fovea::testing::FailsWith;

class GateTest : public ::testing::Test {
 protected:
  static Token MakeEntry(const std::string& name, const std::string& secret) {
    Token token;
    token.name = name;
    token.digest = DigestOf(secret);
    token.prefix = name;
    return token;
  }
  void Write(const std::vector<Token>& tokens) { ASSERT_OK(WriteTokenFile(path_, tokens)); }
  std::unique_ptr<Gate> Open() {
    auto gate = Gate::Open(path_);
    EXPECT_OK(gate.status());
    return *std::move(gate);
  }

  const testing::TemporaryFolder folder_;
  const std::string path_ = folder_ / "tokens.json";
};

TEST_F(GateTest, WithoutAFileEveryoneMayDoEverything) {
  ASSERT_OK_AND_ASSIGN(const auto gate, Gate::Open(""));
  for (const auto& sent : {std::vector<std::string_view>{}, {"Bearer x"}}) {
    ASSERT_OK_AND_ASSIGN(const auto caller, gate->Identify(sent));
    EXPECT_EQ(caller->name(), "");
    EXPECT_TRUE(caller->Sees("any"));
    EXPECT_OK(caller->Check(Right::kWrite));
    EXPECT_OK(caller->TakePixels(int64_t{1} << 40));
    EXPECT_OK(Caller::OpenStream(caller).status());
  }
}

TEST_F(GateTest, KnowsItsTokensAndNoOthers) {
  Write({MakeEntry("lab", "secret-1"), MakeEntry("guest", "secret-2"), MakeEntry("none", "")});
  const auto gate = Open();
  for (const char* sent : {"Bearer secret-1", "bearer secret-1", "BEARER secret-1"}) {
    ASSERT_OK_AND_ASSIGN(const auto caller, gate->Identify({sent}));
    EXPECT_EQ(caller->name(), "lab");
  }
  ASSERT_OK_AND_ASSIGN(const auto guest, gate->Identify({"Bearer secret-2"}));
  EXPECT_EQ(guest->name(), "guest");
  EXPECT_THAT(gate->Identify({}),
              FailsWith(absl::StatusCode::kUnauthenticated, "asks for a token"));
  for (const char* sent :
       {"", "Bearer ", "Bearer", "secret-1", "Basic secret-1", "Bearer  secret-1",
        "Bearer secret-1 ", "Bearer secret-", "Bearer secret-11"}) {
    const auto result = gate->Identify({sent});
    EXPECT_THAT(result, FailsWith(absl::StatusCode::kUnauthenticated, "does not know")) << sent;
    EXPECT_EQ(MessageOf(result.status()).find("secret"), std::string_view::npos);
  }
  EXPECT_THAT(gate->Identify({"Bearer secret-1", "Bearer secret-1"}),
              FailsWith(absl::StatusCode::kUnauthenticated, "does not know"));
}

TEST_F(GateTest, RightsAreWhatTheEntrySays) {
  Token writer = MakeEntry("w", "w");
  writer.right = Right::kWrite;
  const Caller reads(MakeEntry("r", "r"));
  EXPECT_OK(reads.Check(Right::kRead));
  EXPECT_THAT(reads.Check(Right::kWrite), FailsWith(absl::StatusCode::kPermissionDenied, "'r'"));
  EXPECT_OK(Caller(writer).Check(Right::kWrite));
  EXPECT_FALSE(reads.Sees("w"));
}

TEST_F(GateTest, AboveAQuotaTheErrorSaysWhichAndUntilWhen) {
  Token token = MakeEntry("lab", "x");
  token.quotas = {1, 1000, 50};
  const auto caller = std::make_shared<Caller>(token);
  EXPECT_OK(caller->TakePixels(100'000));
  const Status over = caller->TakePixels(1);
  EXPECT_THAT(over, FailsWith(absl::StatusCode::kResourceExhausted, "1000 pixels a second"));
  ASSERT_TRUE(wire::RetryDelayOf(over).has_value());
  EXPECT_GT(*wire::RetryDelayOf(over), std::chrono::seconds(90));
  EXPECT_NE(wire::DescribeDetails(over).find("token:lab"), std::string::npos);
  EXPECT_OK(caller->TakeBytesIn(51));
  EXPECT_THAT(caller->TakeBytesIn(1),
              FailsWith(absl::StatusCode::kResourceExhausted, "50 bytes in a second"));
  {
    ASSERT_OK_AND_ASSIGN(const Caller::Stream stream, Caller::OpenStream(caller));
    EXPECT_THAT(Caller::OpenStream(caller),
                FailsWith(absl::StatusCode::kResourceExhausted, "1 streams at once"));
  }
  EXPECT_OK(Caller::OpenStream(caller).status());
}

TEST_F(GateTest, AReloadKeepsWhatDidNotChangeAndRevokesWhatDid) {
  Token changed = MakeEntry("changed", "2");
  Write({MakeEntry("same", "1"), changed, MakeEntry("gone", "3")});
  const auto gate = Open();
  ASSERT_OK_AND_ASSIGN(const auto same, gate->Identify({"Bearer 1"}));
  ASSERT_OK_AND_ASSIGN(const auto old, gate->Identify({"Bearer 2"}));
  ASSERT_OK_AND_ASSIGN(const auto gone, gate->Identify({"Bearer 3"}));
  changed.quotas.streams = 7;
  Write({changed, MakeEntry("same", "1"), MakeEntry("new", "4")});
  ASSERT_OK(gate->Reload());
  EXPECT_EQ(*gate->Identify({"Bearer 1"}), same);
  EXPECT_OK(same->TakePixels(1));
  EXPECT_NE(*gate->Identify({"Bearer 2"}), old);
  EXPECT_THAT(old->TakePixels(1), FailsWith(absl::StatusCode::kUnavailable, "'changed'"));
  EXPECT_THAT(gate->Identify({"Bearer 3"}),
              FailsWith(absl::StatusCode::kUnauthenticated, "does not know"));
  EXPECT_THAT(Caller::OpenStream(gone), FailsWith(absl::StatusCode::kUnavailable, "'gone'"));
  EXPECT_OK(gate->Identify({"Bearer 4"}).status());
}

TEST_F(GateTest, AReloadOfRubbishChangesNothing) {
  Write({MakeEntry("lab", "1")});
  const auto gate = Open();
  ASSERT_OK_AND_ASSIGN(const auto caller, gate->Identify({"Bearer 1"}));
  std::ofstream(path_) << "{\"tokens\": [{]}";
  EXPECT_THAT(gate->Reload(), FailsWith(absl::StatusCode::kInvalidArgument, path_.c_str()));
  EXPECT_EQ(*gate->Identify({"Bearer 1"}), caller);
  EXPECT_OK(caller->TakePixels(1));
}

}  // namespace
}  // namespace fovea::access
