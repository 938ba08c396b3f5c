#ifndef SERVICE_JOBS_JOB_REPORT_H_
#define SERVICE_JOBS_JOB_REPORT_H_

#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "engine/base/status.h"
#include "service/jobs/job.h"

/// What the process of a job tells the server on its standard output: lines of JSON.
namespace fovea::jobs {

struct ProgressReport {
  int64_t done = 0, total = 0;  // total 0: neither is known yet, and what was known stands
  std::string now;              // the file in hand
};
struct WarningReport {
  std::string text;
};
struct EndReport {
  Status status;
};
using Report = std::variant<ProgressReport, Failure, WarningReport, EndReport>;

/// One line, with its end. Text that is not UTF-8 is mended.
[[nodiscard]] std::string ToLine(const Report& report);
/// Of one line without its end; nothing for a line that is no report.
[[nodiscard]] std::optional<Report> FromLine(std::string_view line);

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_REPORT_H_
