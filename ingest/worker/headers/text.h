#ifndef INGEST_WORKER_HEADERS_TEXT_H_
#define INGEST_WORKER_HEADERS_TEXT_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"

/// Pieces of text headers that may be anything.
namespace fovea::ingest {

/// Takes the next line off `text`, without its end (\n or \r\n); `ended` is whether it had one.
[[nodiscard]] std::string_view TakeLine(std::string_view* text, bool* ended);
/// Without blanks at both ends.
[[nodiscard]] std::string_view Trimmed(std::string_view text);
[[nodiscard]] std::string Lowered(std::string_view text);
/// What stands between blanks.
[[nodiscard]] std::vector<std::string_view> Words(std::string_view text);

/// The whole of `text` as a number. INVALID_ARGUMENT names `what`.
[[nodiscard]] StatusOr<int64_t> IntegerOf(std::string_view text, std::string_view what);
/// NaN and infinity are numbers here.
[[nodiscard]] StatusOr<double> RealOf(std::string_view text, std::string_view what);
/// Numbers between blanks.
[[nodiscard]] StatusOr<std::vector<int64_t>> IntegersOf(std::string_view text,
                                                        std::string_view what);
[[nodiscard]] StatusOr<std::vector<double>> RealsOf(std::string_view text, std::string_view what);

/// Names from a pattern with one %d (or %03d), for first, first + step ... up to last. At most
/// 65536 of them.
[[nodiscard]] StatusOr<std::vector<std::string>> NumberedNames(std::string_view pattern,
                                                               int64_t first, int64_t last,
                                                               int64_t step);

/// A part of a header, safe to show: at most 60 characters.
[[nodiscard]] std::string Shown(std::string_view text);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADERS_TEXT_H_
