#include "service/server/log.h"

#include <cmath>
#include <memory>

#include <nlohmann/json.hpp>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "service/wire/printable.h"

namespace fovea::server {
namespace {

constexpr char kCallLogger[] = "call";
constexpr size_t kMaxMessageBytes = 1000;
LogFormat log_format = LogFormat::kText;  // written by SetUpLog only

using Json = nlohmann::ordered_json;

std::string Dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// {"time":...,"level":...,MEMBERS}. LogCall's lines are members already, others become "message".
class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& line, spdlog::memory_buf_t& out) override {
    const std::string_view payload(line.payload.data(), line.payload.size());
    const std::string_view logger(line.logger_name.data(), line.logger_name.size());
    const std::string members =
        logger == kCallLogger ? std::string(payload) : FormatMessage(payload);
    head_.format(line, out);
    out.append(members.data() + 1, members.data() + members.size());
    out.push_back('\n');
  }
  [[nodiscard]] std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<JsonFormatter>();
  }

 private:
  spdlog::pattern_formatter head_{R"({"time":"%Y-%m-%dT%H:%M:%S.%eZ","level":"%l",)",
                                  spdlog::pattern_time_type::utc, ""};
};

spdlog::level::level_enum LevelOf(const CallLine& call) {
  if (absl::IsNotFound(call.status) && call.method.ends_with("/Acknowledge")) {
    return spdlog::level::debug;  // a client cannot know which frame was the last
  }
  switch (call.status.code()) {
    case absl::StatusCode::kOk:
      return spdlog::level::debug;
    case absl::StatusCode::kResourceExhausted:
      return spdlog::level::warn;
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kUnknown:
      return spdlog::level::err;
    default:
      return spdlog::level::info;
  }
}

}  // namespace

void SetUpLog(const std::string& level, LogFormat format) {
  log_format = format;
  const auto sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
  if (format == LogFormat::kJson) {
    sink->set_formatter(std::make_unique<JsonFormatter>());
  } else {
    sink->set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %l %v");
  }
  auto general = std::make_shared<spdlog::logger>("fovead", sink);
  auto calls = std::make_shared<spdlog::logger>(kCallLogger, sink);
  general->set_level(spdlog::level::from_str(level));
  calls->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(std::move(general));
  spdlog::drop(kCallLogger);
  spdlog::register_logger(std::move(calls));
}

void LogCall(const CallLine& call) {
  const auto level = LevelOf(call);
  const auto logger = spdlog::get(kCallLogger);  // none in tests that set up no log
  if (logger != nullptr && logger->should_log(level)) {
    logger->log(level, "{}", FormatCall(call, log_format));
  }
}

std::string FormatCall(const CallLine& call, LogFormat format) {
  const std::string code = absl::StatusCodeToString(call.status.code());
  const std::string method = wire::Printable(call.method);
  if (format == LogFormat::kText) {
    return fmt::format("{} '{}': {} in {:.1f} ms, {} bytes [{} {} {}]{}{}", method,
                       wire::Printable(call.dataset), code, call.ms, call.bytes_sent,
                       call.request_id, call.client.empty() ? "-" : call.client, call.peer,
                       call.status.ok() ? "" : ": ",
                       wire::Printable(MessageOf(call.status), kMaxMessageBytes));
  }
  Json json{{"method", method},
            {"request_id", call.request_id},
            {"client", call.client},
            {"peer", call.peer},
            {"dataset", wire::Printable(call.dataset)},
            {"code", code},
            {"ms", std::round(call.ms * 1000) / 1000},
            {"bytes_sent", call.bytes_sent}};
  if (!call.status.ok()) {
    json["message"] = wire::Printable(MessageOf(call.status), kMaxMessageBytes);
  }
  return Dump(json);
}

std::string FormatMessage(std::string_view message) {
  return Dump(Json{{"message", message}});
}

}  // namespace fovea::server
