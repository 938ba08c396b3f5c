#include "service/server/log.h"

#include <cstdio>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

CallLine SomeCall() {
  return {.method = "fovea.v1.Render/RenderFrame",
          .request_id = "0123456789abcdef",
          .client = "token:lab",
          .peer = "ipv4:127.0.0.1:4242",
          .dataset = "a\"b\nc\xff",
          .ms = 12.5,
          .bytes_sent = 1024,
          .status = MakeStatus(absl::StatusCode::kNotFound, "no 'x'\n{\"level\":\"forged\"}")};
}

TEST(LogTest, ACallIsOneLineForPeople) {
  const std::string line = FormatCall(SomeCall(), LogFormat::kText);
  EXPECT_THAT(line, HasSubstr("fovea.v1.Render/RenderFrame 'a\"b\\x0ac"));
  EXPECT_THAT(line, HasSubstr("NOT_FOUND in 12.5 ms, 1024 bytes [0123456789abcdef token:lab "
                              "ipv4:127.0.0.1:4242]: no 'x'\\x0a"));
  EXPECT_THAT(line, Not(HasSubstr("\n")));
}

TEST(LogTest, ACallIsOneObjectForMachines) {
  const std::string line = FormatCall(SomeCall(), LogFormat::kJson);
  EXPECT_THAT(line, Not(HasSubstr("\n")));
  const Json json = Json::parse(line);
  EXPECT_EQ(json["method"], "fovea.v1.Render/RenderFrame");
  EXPECT_EQ(json["request_id"], "0123456789abcdef");
  EXPECT_EQ(json["client"], "token:lab");
  EXPECT_EQ(json["code"], "NOT_FOUND");
  EXPECT_EQ(json["ms"], 12.5);
  EXPECT_EQ(json["bytes_sent"], 1024);
  EXPECT_FALSE(json.contains("level"));
  EXPECT_EQ(
      Json::parse(FormatMessage("\"quoted\" \xff\x01"))["message"].get<std::string>().substr(0, 8),
      "\"quoted\"");
}

class LogOfAServerTest : public ServerFixture {};

/// Everything that a server logs, whatever goes wrong, is JSON and holds no token.
TEST_F(LogOfAServerTest, HoldsEveryCallAndNoToken) {
  constexpr char kToken[] = "correct-horse-battery-staple";
  constexpr char kSha256[] = "2c1e7b58ab41d6a7f6a5c4cdbf5a2a0e0b0a9d7cdb80b1cbbd1a4f0d7dbcb6ff";
  const std::string tokens = folder_.Path("tokens.json");
  std::ofstream(tokens) << R"({"tokens": [{"name": "lab", "sha256": ")" << kSha256
                        << R"(", "prefix": "", "rights": "read"}]})";
  ::testing::internal::CaptureStderr();
  SetUpLog("trace", LogFormat::kJson);
  StartServer(1, 4, tokens);
  std::string id;
  {
    grpc::ClientContext context;
    context.AddMetadata("authorization", std::string("Bearer ") + kToken);
    v1::GetDatasetRequest request;
    request.set_dataset("plume");
    v1::Dataset dataset;
    EXPECT_EQ(datasets_->GetDataset(&context, request, &dataset).error_code(),
              grpc::StatusCode::UNAUTHENTICATED);
    const auto& trailing = context.GetServerTrailingMetadata();
    id = std::string(trailing.find("fovea-request-id")->second.data(), 16);
  }
  server_.reset();
  spdlog::default_logger()->flush();
  std::fflush(stderr);
  const std::string log = ::testing::internal::GetCapturedStderr();
  SetUpLog("off", LogFormat::kText);

  EXPECT_THAT(log, Not(HasSubstr(kToken)));
  bool found = false;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    const Json json = Json::parse(line, nullptr, false);
    ASSERT_FALSE(json.is_discarded()) << line;
    EXPECT_TRUE(json.contains("time") && json.contains("level")) << line;
    found = found || json.value("request_id", "") == id;
  }
  EXPECT_TRUE(found) << log;
}

}  // namespace
}  // namespace fovea::server
