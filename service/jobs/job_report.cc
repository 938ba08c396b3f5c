#include "service/jobs/job_report.h"

#include <nlohmann/json.hpp>

namespace fovea::jobs {
namespace {

using Json = nlohmann::json;

struct Writer {
  Json operator()(const ProgressReport& report) const {
    return {{"done", report.done}, {"total", report.total}, {"now", report.now}};
  }
  Json operator()(const Failure& failure) const {
    return {{"file", failure.file}, {"reason", failure.reason}};
  }
  Json operator()(const WarningReport& report) const { return {{"warning", report.text}}; }
  Json operator()(const EndReport& report) const {
    return {{"code", static_cast<int>(report.status.code())},
            {"message", std::string(MessageOf(report.status))}};
  }
};

template <typename T>
bool Take(const Json& json, const char* key, T* value) {
  const auto at = json.find(key);
  if (at == json.end() ||
      !(std::is_same_v<T, std::string> ? at->is_string() : at->is_number_integer())) {
    return false;
  }
  at->get_to(*value);
  return true;
}

}  // namespace

std::string ToLine(const Report& report) {
  return std::visit(Writer(), report).dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::optional<Report> FromLine(std::string_view line) {
  const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) {
    return std::nullopt;
  }
  ProgressReport progress;
  if (Take(json, "done", &progress.done) && Take(json, "total", &progress.total) &&
      Take(json, "now", &progress.now)) {
    return progress;
  }
  Failure failure;
  if (Take(json, "file", &failure.file) && Take(json, "reason", &failure.reason)) {
    return failure;
  }
  WarningReport warning;
  if (Take(json, "warning", &warning.text)) {
    return warning;
  }
  int code = 0;
  std::string message;
  if (Take(json, "code", &code) && Take(json, "message", &message) && code >= 0 && code <= 16) {
    return EndReport{MakeStatus(static_cast<absl::StatusCode>(code), message)};
  }
  return std::nullopt;
}

}  // namespace fovea::jobs
