#ifndef SERVICE_CLI_NUMBER_LIST_H_
#define SERVICE_CLI_NUMBER_LIST_H_

#include <charconv>
#include <optional>
#include <span>
#include <string_view>
#include <system_error>

/// Numbers in the texts that flags take.
namespace fovea::cli {

/// The whole of `text` as a number, or nothing.
template <typename T>
std::optional<T> Number(std::string_view text) {
  if (text.starts_with('+')) {
    text.remove_prefix(1);
  }
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    return std::nullopt;
  }
  return value;
}

inline std::string_view Trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') {
    text.remove_prefix(1);
  }
  while (!text.empty() && text.back() == ' ') {
    text.remove_suffix(1);
  }
  return text;
}

/// Exactly out.size() numbers with `separator` between them.
template <typename T>
bool ReadList(std::string_view text, char separator, std::span<T> out) {
  for (size_t i = 0; i < out.size(); ++i) {
    const size_t end = text.find(separator);
    const bool last = i + 1 == out.size();
    if (last != (end == std::string_view::npos)) {
      return false;
    }
    const std::optional<T> value = Number<T>(Trimmed(text.substr(0, end)));
    if (!value) {
      return false;
    }
    out[i] = *value;
    text.remove_prefix(last ? text.size() : end + 1);
  }
  return true;
}

}  // namespace fovea::cli

#endif  // SERVICE_CLI_NUMBER_LIST_H_
