#ifndef INGEST_SENSORS_READING_PARSER_H_
#define INGEST_SENSORS_READING_PARSER_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "engine/sensors/reading_binner.h"

/// Bytes of foreign files to readings: pure functions of their bytes, without I/O. They run in the
/// program itself, not in the worker (docs/decisions/0017-sensors.md says why that is safe here).
namespace fovea::ingest {

/// Readings, and one value a channel for each.
struct ReadingBlock {
  std::vector<sensors::Reading> readings;
  std::vector<float> values;  // [reading][channel]
  void Clear() {
    readings.clear();
    values.clear();
  }
};

/// Seconds: a number, times `unit_s`, or an ISO 8601 date and time, 2020-02-07T13:00:00.5Z (a
/// space for the T; +01:00 for the Z, which may be left out), in seconds since 1970-01-01 UTC.
[[nodiscard]] std::optional<double> ParseTime(std::string_view text, double unit_s);

enum class ReadingFormat {
  kCsv,        // lines of fields between commas, semicolons or tabs
  kJsonLines,  // an object a line
  kRecords,    // float32 little-endian x, y, z, t, value
};

/// Which column of a CSV file (its name in the header, or its number from 1) or which key of JSON
/// objects is what. Empty: found by its name, as docs/sensors.md lists them.
struct ReadingColumns {
  std::string time, x, y, z;
  std::string step;                 // names the step; empty: none does
  std::vector<std::string> values;  // one a channel; empty: one channel, found
};

/// Texts that name steps as numbers: themselves if the first one is a whole number, then all must
/// be; otherwise 0, 1, 2 in the order in which they are met.
class StepKeys {
 public:
  [[nodiscard]] StatusOr<int64_t> NumberOf(std::string_view text);

 private:
  enum class Kind { kUnknown, kNumbers, kNames };
  Kind kind_ = Kind::kUnknown;
  std::map<std::string, int64_t, std::less<>> names_;
};

/// How many bad lines are bearable, and what was met. Shared by the parsers of one ingest.
struct BadLines {
  int64_t most = 0;
  int64_t count = 0;
  std::string first;  // file, line, and what is wrong with it
};

struct ParserOptions {
  ReadingFormat format = ReadingFormat::kCsv;
  ReadingColumns columns;
  char separator = 0;        // CSV: 0 to find it in the first line
  double time_unit_s = 1;    // what numbers of the time column count
  StepKeys* keys = nullptr;  // with columns.step
  BadLines* bad = nullptr;   // not null
};

/// Reads one file or stream from its start. Not thread-safe.
class ReadingParser {
 public:
  virtual ~ReadingParser() = default;

  /// Appends the readings of all whole lines or records at the start of `bytes` to *out, and
  /// returns how many bytes they took: call again with the rest in front of what comes next.
  /// `last`: nothing comes next. INVALID_ARGUMENT, naming file, line and what to do, for a header
  /// that lacks a column, for one bad line more than bearable, for a line of more than 1 MiB.
  [[nodiscard]] virtual StatusOr<size_t> Parse(std::string_view bytes, bool last,
                                               ReadingBlock* out) = 0;
  /// What the channels are called in the file; empty before the header or the first object.
  [[nodiscard]] virtual const std::vector<std::string>& value_names() const = 0;
};

/// `name`: of the file, for messages.
[[nodiscard]] std::unique_ptr<ReadingParser> MakeReadingParser(const ParserOptions& options,
                                                               std::string name);

}  // namespace fovea::ingest

#endif  // INGEST_SENSORS_READING_PARSER_H_
