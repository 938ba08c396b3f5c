#ifndef SERVICE_WIRE_PRINTABLE_H_
#define SERVICE_WIRE_PRINTABLE_H_

#include <cstddef>
#include <string>
#include <string_view>

namespace fovea::wire {

/// `text` from outside, fit for an error message or a log line: control characters escaped, and
/// cut (with "...") at `max_bytes`.
[[nodiscard]] std::string Printable(std::string_view text, size_t max_bytes = 120);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_PRINTABLE_H_
