#include "ingest/worker/headers/text.h"

#include <algorithm>
#include <charconv>

namespace fovea::ingest {
namespace {

constexpr std::string_view kBlanks = " \t\r\n\v\f";
constexpr int64_t kMaxNames = 65536;

template <typename T>
StatusOr<T> NumberOf(std::string_view text, std::string_view what) {
  T value{};
  std::string_view digits = text.starts_with('+') ? text.substr(1) : text;
  const auto [stopped, error] =
      std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || stopped != digits.data() + digits.size()) {
    return InvalidArgument("{} '{}' is not a number", what, Shown(text));
  }
  return value;
}

template <typename T>
StatusOr<std::vector<T>> NumbersOf(std::string_view text, std::string_view what) {
  std::vector<T> numbers;
  for (const std::string_view word : Words(text)) {
    FOVEA_ASSIGN_OR_RETURN(const T number, NumberOf<T>(word, what));
    numbers.push_back(number);
  }
  return numbers;
}

}  // namespace

std::string_view TakeLine(std::string_view* text, bool* ended) {
  const size_t end = text->find('\n');
  *ended = end != std::string_view::npos;
  std::string_view line = text->substr(0, end);
  text->remove_prefix(*ended ? end + 1 : text->size());
  if (line.ends_with('\r')) {
    line.remove_suffix(1);
  }
  return line;
}

std::string_view Trimmed(std::string_view text) {
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) {
    return {};
  }
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

std::string Lowered(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  return lower;
}

std::vector<std::string_view> Words(std::string_view text) {
  std::vector<std::string_view> words;
  for (size_t begin = text.find_first_not_of(kBlanks); begin != std::string_view::npos;
       begin = text.find_first_not_of(kBlanks, begin)) {
    const size_t end = std::min(text.find_first_of(kBlanks, begin), text.size());
    words.push_back(text.substr(begin, end - begin));
    begin = end;
  }
  return words;
}

StatusOr<int64_t> IntegerOf(std::string_view text, std::string_view what) {
  return NumberOf<int64_t>(text, what);
}

StatusOr<double> RealOf(std::string_view text, std::string_view what) {
  return NumberOf<double>(text, what);
}

StatusOr<std::vector<int64_t>> IntegersOf(std::string_view text, std::string_view what) {
  return NumbersOf<int64_t>(text, what);
}

StatusOr<std::vector<double>> RealsOf(std::string_view text, std::string_view what) {
  return NumbersOf<double>(text, what);
}

StatusOr<std::vector<std::string>> NumberedNames(std::string_view pattern, int64_t first,
                                                 int64_t last, int64_t step) {
  const size_t percent = pattern.find('%');
  const size_t letter = percent == std::string_view::npos
                            ? percent
                            : pattern.find_first_not_of("0123456789", percent + 1);
  if (letter == std::string_view::npos || (pattern[letter] != 'd' && pattern[letter] != 'i') ||
      letter - percent > 3 || pattern.find('%', letter) != std::string_view::npos) {
    return InvalidArgument("data files '{}': one number such as %03d is needed", Shown(pattern));
  }
  const std::string_view digits = pattern.substr(percent + 1, letter - percent - 1);
  const bool padded = digits.starts_with('0');
  int64_t width = 0;
  if (!digits.empty()) {
    FOVEA_ASSIGN_OR_RETURN(width, IntegerOf(digits, "width"));
  }
  if (step == 0 || first < 0 || last < 0 || first > (int64_t{1} << 40) ||
      last > (int64_t{1} << 40) || (last - first) / step < 0 ||
      (last - first) / step >= kMaxNames) {
    return InvalidArgument("data files '{}' from {} to {} by {}: 1 to {} files can be",
                           Shown(pattern), first, last, step, kMaxNames);
  }
  std::vector<std::string> names;
  for (int64_t i = 0; i <= (last - first) / step; ++i) {
    const std::string number = padded ? fmt::format("{:0{}}", first + i * step, width)
                                      : fmt::format("{:{}}", first + i * step, width);
    names.push_back(std::string(pattern.substr(0, percent)) + number +
                    std::string(pattern.substr(letter + 1)));
  }
  return names;
}

std::string Shown(std::string_view text) {
  constexpr size_t kMost = 60;
  std::string shown(text.substr(0, kMost));
  for (char& c : shown) {
    c = c >= ' ' && c <= '~' ? c : '?';
  }
  return text.size() > kMost ? shown + "..." : shown;
}

}  // namespace fovea::ingest
