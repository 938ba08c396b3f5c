#ifndef TESTS_SUPPORT_STATUS_MATCHERS_H_
#define TESTS_SUPPORT_STATUS_MATCHERS_H_

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/base/status.h"

namespace fovea::testing {

inline const Status& StatusOf(const Status& status) {
  return status;
}
template <typename T>
const Status& StatusOf(const StatusOr<T>& result) {
  return result.status();
}

MATCHER(IsOk, "is OK") {
  *result_listener << MessageOf(StatusOf(arg));
  return StatusOf(arg).ok();
}

/// Has this code, and a message that contains `text`.
MATCHER_P2(FailsWith, code, text, "fails with the code and text") {
  *result_listener << absl::StatusCodeToString(StatusOf(arg).code()).c_str() << ": "
                   << std::string(MessageOf(StatusOf(arg)));
  return StatusOf(arg).code() == code &&
         MessageOf(StatusOf(arg)).find(text) != std::string_view::npos;
}

}  // namespace fovea::testing

#define ASSERT_OK(expression) ASSERT_THAT(expression, ::fovea::testing::IsOk())
#define EXPECT_OK(expression) EXPECT_THAT(expression, ::fovea::testing::IsOk())

/// ASSERT_OK_AND_ASSIGN(auto x, MakeX());
#define ASSERT_OK_AND_ASSIGN(target, expression) \
  ASSERT_OK_AND_ASSIGN_(FOVEA_CONCAT(fovea_value_, __LINE__), target, expression)
#define ASSERT_OK_AND_ASSIGN_(result, target, expression) \
  auto result = (expression);                             \
  ASSERT_THAT(result.status(), ::fovea::testing::IsOk()); \
  target = std::move(result).value()

#endif  // TESTS_SUPPORT_STATUS_MATCHERS_H_
