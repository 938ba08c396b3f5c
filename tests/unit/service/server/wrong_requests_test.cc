// Requests with one value outside the range that the proto says: each is refused, and told which.

#include "tests/unit/service/server/wrong_requests.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using google::protobuf::FieldDescriptor;

/// "METHOD:PATH" of every field that a request can have.
void AddPaths(const google::protobuf::Descriptor& type, const std::string& prefix,
              std::set<std::string>* paths) {
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& field = *type.field(i);
    const std::string path = prefix + field.name();
    if (field.message_type() == nullptr) {
      paths->insert(path);
    } else {
      AddPaths(*field.message_type(), path + (field.is_repeated() ? "[]." : "."), paths);
    }
  }
}

std::vector<absl::StatusCode> CodesOf(const Rule& rule) {
  switch (rule.is) {
    case Is::kStep:
      return {absl::StatusCode::kOutOfRange, absl::StatusCode::kInvalidArgument};
    case Is::kTime:
      return {absl::StatusCode::kOutOfRange};
    case Is::kName:
    case Is::kFile:
      return {absl::StatusCode::kNotFound, absl::StatusCode::kInvalidArgument};
    default:
      return {absl::StatusCode::kInvalidArgument};
  }
}

/// Whether the error says which field it is about: in its details the field, one that holds it or
/// one of it; or its name in the message.
bool Names(const Status& status, const std::string& path, const Rule& rule) {
  const std::string field = wire::FieldOf(status);
  const std::string whole = WithoutIndices(path);
  const bool is_group = field.empty() || field == "spec" || field == "header" || field == "batch";
  const std::string told = WithoutIndices(field);
  if (!is_group && (whole.starts_with(told) || told.starts_with(whole))) {
    return true;
  }
  std::string name = path;
  for (const char* part : {".x", ".y", ".z", ".red", ".green", ".blue", ".at"}) {
    name = name.ends_with(part) ? name.substr(0, name.rfind('.')) : name;
  }
  name = name.substr(name.rfind('.') + 1);
  const std::string message(MessageOf(status));
  return message.find(name) != std::string::npos ||
         (*rule.also != '\0' && (message + field).find(rule.also) != std::string::npos);
}

class WrongRequestsTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    allow_ingest_ = keeps_jobs_ = true;
    StartServer();
    for (const char* file : {"in/a_0.raw", "in/a_1.raw"}) {
      std::ofstream(folder_.Path(file)) << std::string(16 * 16 * 16, 'x');
    }
  }

  void Check(const Wrong& wrong) {
    const RawReply reply = Send(channel_, wrong.call);
    const std::string what =
        fmt::format("{} {}: {}", wrong.call.method, wrong.path, reply.status.ToString());
    EXPECT_LT(reply.replies, wrong.call.messages.size()) << what;
    EXPECT_THAT(CodesOf(*wrong.rule), ::testing::Contains(reply.status.code())) << what;
    EXPECT_TRUE(Names(reply.status, wrong.path, *wrong.rule)) << what;
  }
};

TEST_F(WrongRequestsTest, GoodRequestsAreGood) {
  std::set<const google::protobuf::MethodDescriptor*> methods;
  for (const GoodRequest& good : GoodRequests()) {
    methods.insert(good.method);
    RawCall call;
    call.method = good.Path();
    for (const auto& message : good.messages) {
      call.messages.push_back(message->SerializeAsString());
    }
    const RawReply reply = Send(channel_, call);
    if (good.code == absl::StatusCode::kOk) {
      EXPECT_EQ(reply.replies, 1U) << call.method << ": " << reply.status;
    } else {
      EXPECT_EQ(reply.status.code(), good.code) << call.method << ": " << reply.status;
    }
  }
  for (const auto* method : AllMethods()) {
    EXPECT_EQ(methods.count(method), 1U) << method->full_name() << " has no good request";
  }
}

TEST_F(WrongRequestsTest, EveryFieldHasADocumentedRangeAndAGoodValue) {
  const WrongRequests wrong = MakeWrongRequests(GoodRequests());
  EXPECT_THAT(wrong.no_rule, ::testing::IsEmpty()) << "add their ranges: documented_ranges.cc";
  std::set<std::string> paths;
  for (const auto* method : AllMethods()) {
    AddPaths(*method->input_type(), method->name() + ":", &paths);
  }
  for (const std::string& path : paths) {
    const bool has_rule = RuleOf("", path.substr(path.find(':') + 1)) != nullptr;
    EXPECT_TRUE(has_rule || wrong.fields.contains(path))
        << path << " is in no good request: good_requests.cc";
  }
}

TEST_F(WrongRequestsTest, EveryValueOutsideItsRangeIsRefusedByName) {
  const WrongRequests wrong = MakeWrongRequests(GoodRequests());
  EXPECT_GE(wrong.all.size(), 1000U);
  RecordProperty("requests", static_cast<int>(wrong.all.size()));
  std::map<std::string, std::vector<const Wrong*>> by_method;
  for (const Wrong& one : wrong.all) {
    by_method[one.call.method].push_back(&one);
  }
  std::vector<std::thread> clients;  // one a method: readings have one writer at a time
  for (const auto& [method, requests] : by_method) {
    clients.emplace_back([this, &requests] {
      for (const Wrong* one : requests) {
        Check(*one);
      }
    });
  }
  for (std::thread& client : clients) {
    client.join();
  }
  // What comes before a wrong message may be drawn.
  const auto after_others = std::count_if(wrong.all.begin(), wrong.all.end(), [](const Wrong& one) {
    return one.call.messages.size() > 1;
  });
  EXPECT_LE(server_->frames_rendered(), static_cast<uint64_t>(after_others));
}

}  // namespace
}  // namespace fovea::server
