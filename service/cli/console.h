#ifndef SERVICE_CLI_CONSOLE_H_
#define SERVICE_CLI_CONSOLE_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "engine/base/status.h"
#include "engine/base/stopwatch.h"
#include "service/cli/commands.h"

/// Talking to people and to scripts: results on stdout, everything else on stderr.
namespace fovea::cli {

/// From now on the first SIGINT or SIGTERM only sets Interrupted; the next one ends the process.
/// SIGPIPE and SIGXFSZ are ignored: writing then fails, and says so.
void InstallSignalHandlers();
/// SIGINT and SIGTERM end the process again, as where nothing was installed.
void ResetSignalHandlers();
[[nodiscard]] bool Interrupted();

/// One line on stdout. A closed stdout ends the output silently.
void PrintLine(std::string_view line);
/// One JSON value as a line on stdout; file names that are no UTF-8 get replacement characters.
void PrintJson(const nlohmann::json& value);
/// One line on stderr, also if quiet: what is wrong with what is made.
void Warn(std::string_view message);
/// One line on stderr, unless quiet.
void Note(const OutputOptions& output, std::string_view line);
/// "fovea: ..." on stderr.
void PrintError(std::string_view message);

/// The message of an error. If it is about a value that was given, and its first word is a field of
/// the proto, the flag for that field comes in front: "--rate: rate 0 is ...".
[[nodiscard]] std::string WithFlag(const Status& error);

/// "1 step", "2 steps".
[[nodiscard]] std::string CountOf(int64_t count, std::string_view unit);
/// Of a field whose steps a repair could not save: "steps 3, 7 to 9 of field 'density', ...".
[[nodiscard]] std::string DescribeLost(const std::string& field, const std::vector<int64_t>& steps);
/// 1536 -> "1.5 KiB".
[[nodiscard]] std::string HumanBytes(uint64_t bytes);
/// 75.3 -> "1 min 15 s".
[[nodiscard]] std::string HumanSeconds(double seconds);

/// How far long work has come, with rate and time left: a line that is rewritten on a terminal, a
/// plain line now and then elsewhere. Erases its line when it goes.
class Progress {
 public:
  /// `unit`: what is counted, "steps".
  Progress(const OutputOptions& output, std::string what, std::string unit);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `total` below 0: unknown.
  void Update(int64_t done, int64_t total, std::string_view now = "");
  /// The same for work whose pace another knows: this line, which is of `done`. `last`: shown even
  /// if the line before was shown a moment ago.
  void Show(int64_t done, bool last, std::string line);

 private:
  [[nodiscard]] std::string Line(int64_t done, int64_t total, std::string_view now) const;

  bool quiet_;
  bool terminal_;
  std::string what_, unit_;
  Stopwatch since_start_, since_shown_;
  int64_t first_done_ = -1;  // what was done before we started counting
  int64_t shown_done_ = -1;
  bool line_open_ = false;
};

}  // namespace fovea::cli

#endif  // SERVICE_CLI_CONSOLE_H_
