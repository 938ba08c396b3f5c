#ifndef SERVICE_SERVER_LOG_H_
#define SERVICE_SERVER_LOG_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/status.h"

/// The server's log on stderr: lines for people, or one JSON object a line. Thread-safe after
/// SetUpLog.
namespace fovea::server {

enum class LogFormat { kText, kJson };

/// Once a process, before anything is logged. `level`: trace, debug, info, warn, err or off.
void SetUpLog(const std::string& level, LogFormat format);

/// A call that ended. Holds no token, and nothing of the request but its dataset.
struct CallLine {
  std::string_view method;      // "fovea.v1.Render/RenderFrame"
  std::string_view request_id;  // what the client got as `fovea-request-id`
  std::string_view client;      // the token's name, else the address; empty if it was not let in
  std::string_view peer;        // "127.0.0.1:50123"
  std::string_view dataset;     // as the client wrote it; may be empty
  double ms = 0;
  int64_t bytes_sent = 0;
  Status status;
};

/// One line: what went well as debug, what the client did wrong as information, what was refused
/// for want of something as a warning, what the server did wrong as an error.
void LogCall(const CallLine& call);

/// How LogCall writes it: text, or the members of a JSON object in braces.
[[nodiscard]] std::string FormatCall(const CallLine& call, LogFormat format);
/// The members of a JSON object for any other line, in braces.
[[nodiscard]] std::string FormatMessage(std::string_view message);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_LOG_H_
