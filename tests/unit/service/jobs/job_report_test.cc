#include "service/jobs/job_report.h"

#include <gtest/gtest.h>

namespace fovea::jobs {
namespace {

template <typename T>
T Back(const T& report) {
  std::string line = ToLine(report);
  EXPECT_EQ(line.back(), '\n');
  line.pop_back();
  EXPECT_EQ(line.find('\n'), std::string::npos);
  const auto back = FromLine(line);
  return back && std::holds_alternative<T>(*back) ? std::get<T>(*back) : T{};
}

TEST(JobReportTest, LinesComeBack) {
  const ProgressReport progress = Back(ProgressReport{3, 7, "a \"file\"\nname.raw"});
  EXPECT_EQ(progress.done, 3);
  EXPECT_EQ(progress.total, 7);
  EXPECT_EQ(progress.now, "a \"file\"\nname.raw");
  EXPECT_EQ(Back(Failure{"f.raw", "why"}), (Failure{"f.raw", "why"}));
  EXPECT_EQ(Back(WarningReport{"odd"}).text, "odd");
  EXPECT_EQ(Back(EndReport{NotFound("gone")}).status, NotFound("gone"));
  EXPECT_EQ(Back(EndReport{absl::OkStatus()}).status, absl::OkStatus());
  EXPECT_EQ(Back(Failure{"\xff.raw", ""}).file, "\xEF\xBF\xBD.raw");
}

TEST(JobReportTest, OtherLinesAreNone) {
  for (const char* line : {"", "x", "[]", "{}", "{\"done\":1}",
                           "{\"done\":\"1\",\"total\":2,"
                           "\"now\":\"\"}",
                           "{\"code\":99,\"message\":\"\"}"}) {
    EXPECT_FALSE(FromLine(line).has_value()) << line;
  }
}

}  // namespace
}  // namespace fovea::jobs
