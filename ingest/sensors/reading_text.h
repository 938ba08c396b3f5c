#ifndef INGEST_SENSORS_READING_TEXT_H_
#define INGEST_SENSORS_READING_TEXT_H_

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "ingest/sensors/reading_parser.h"

/// The texts inside lines of readings, and which of them is what.
namespace fovea::ingest::internal {

/// Lines longer than this are no readings.
inline constexpr size_t kMostLineBytes = size_t{1} << 20;

/// Without spaces and tabs at either end.
[[nodiscard]] std::string_view Trim(std::string_view text);

/// A number as people write it: "1", "+1.5e3", "nan", "-inf". Nothing there, NA, N/A, null and
/// none (in any case) are NaN: no value was measured. Nothing for any other text.
[[nodiscard]] std::optional<double> ParseReal(std::string_view text);

/// What a text in a line is for.
enum class Role { kTime, kX, kY, kZ, kStep };
inline constexpr int kRoles = 5;

/// Where in a line, or at which key, everything is.
struct Places {
  std::array<int, kRoles> of_role{-1, -1, -1, -1, -1};  // -1: nowhere
  std::vector<int> of_value;                            // of each channel
};

/// Finds everything among the names of a header or of an object's keys. INVALID_ARGUMENT, listing
/// the names, if something is asked for that is not there, or if x, y or the value is in doubt.
[[nodiscard]] StatusOr<Places> FindPlaces(const ReadingColumns& wanted,
                                          std::span<const std::string> names);

/// One reading out of the texts of a line, appended to *out. The reason if it is none.
[[nodiscard]] Status AppendReading(const Places& places, std::span<const std::string_view> texts,
                                   const ParserOptions& options, ReadingBlock* out);

/// Counts a bad line: `problem` with file and line in front once too many are bad.
[[nodiscard]] Status CountBadLine(const std::string& file, int64_t line, const Status& problem,
                                  BadLines* bad);

[[nodiscard]] std::unique_ptr<ReadingParser> MakeCsvParser(const ParserOptions& options,
                                                           std::string name);
[[nodiscard]] std::unique_ptr<ReadingParser> MakeJsonLinesParser(const ParserOptions& options,
                                                                 std::string name);
[[nodiscard]] std::unique_ptr<ReadingParser> MakeRecordParser(std::string name);

/// Takes whole lines off `bytes`, without their \n or \r\n, and calls `on_line(line)`, which
/// returns a Status. Returns the bytes that they took.
template <typename OnLine>
StatusOr<size_t> ForEachLine(std::string_view bytes, bool last, const std::string& file,
                             int64_t* line_number, const OnLine& on_line) {
  size_t done = 0;
  while (done < bytes.size()) {
    const size_t end = bytes.find('\n', done);
    const size_t size = (end == std::string_view::npos ? bytes.size() : end) - done;
    if (size > kMostLineBytes) {
      return InvalidArgument("{}:{}: a line of more than {} bytes; is it a file of readings?", file,
                             *line_number + 1, kMostLineBytes);
    }
    if (end == std::string_view::npos && !last) {
      break;
    }
    ++*line_number;
    std::string_view line = bytes.substr(done, size);
    if (line.ends_with('\r')) {
      line.remove_suffix(1);
    }
    FOVEA_RETURN_IF_ERROR(on_line(line));
    done = end == std::string_view::npos ? bytes.size() : end + 1;
  }
  return done;
}

}  // namespace fovea::ingest::internal

#endif  // INGEST_SENSORS_READING_TEXT_H_
