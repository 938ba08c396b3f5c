#ifndef TESTS_UNIT_SERVICE_SERVER_WRONG_REQUESTS_H_
#define TESTS_UNIT_SERVICE_SERVER_WRONG_REQUESTS_H_

#include <set>
#include <string>
#include <vector>

#include "tests/unit/service/server/documented_ranges.h"
#include "tests/unit/service/server/good_requests.h"
#include "tests/unit/service/server/raw_call.h"

namespace fovea::server {

/// A good request of which one value is outside its range.
struct Wrong {
  RawCall call;
  std::string path;  // in the message, with indices
  const Rule* rule = nullptr;
};

/// Always the same ones.
struct WrongRequests {
  std::vector<Wrong> all;
  std::set<std::string> fields;   // "METHOD:PATH" of those that good requests have
  std::set<std::string> no_rule;  // likewise: nothing says what they may be
};
[[nodiscard]] WrongRequests MakeWrongRequests(const std::vector<GoodRequest>& good);

/// "held[3].step" as rules have it: "held[].step".
[[nodiscard]] std::string WithoutIndices(const std::string& path);

}  // namespace fovea::server

#endif  // TESTS_UNIT_SERVICE_SERVER_WRONG_REQUESTS_H_
