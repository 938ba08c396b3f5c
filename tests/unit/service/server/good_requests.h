#ifndef TESTS_UNIT_SERVICE_SERVER_GOOD_REQUESTS_H_
#define TESTS_UNIT_SERVICE_SERVER_GOOD_REQUESTS_H_

#include <memory>
#include <string>
#include <vector>

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include "engine/base/status.h"

namespace fovea::server {

/// A call that does what it should on the stores of ServerFixture, with folders for jobs: what
/// attacks on the server start from.
struct GoodRequest {
  const google::protobuf::MethodDescriptor* method = nullptr;
  std::vector<std::shared_ptr<google::protobuf::Message>> messages;  // of the client, in order
  absl::StatusCode code = absl::StatusCode::kOk;  // what it asks about may not be there

  /// "/package.Service/Method"
  [[nodiscard]] std::string Path() const {
    return "/" + method->service()->full_name() + "/" + method->name();
  }
};

/// Of every method of every service of fovea.v1 at least one; together they have every field set.
[[nodiscard]] std::vector<GoodRequest> GoodRequests();

/// Every method of every service of fovea.v1.
[[nodiscard]] std::vector<const google::protobuf::MethodDescriptor*> AllMethods();

}  // namespace fovea::server

#endif  // TESTS_UNIT_SERVICE_SERVER_GOOD_REQUESTS_H_
