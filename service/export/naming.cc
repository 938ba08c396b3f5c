#include "service/export/naming.h"

#include <cctype>
#include <cstdlib>
#include <optional>

namespace fovea::exports {
namespace {

/// Where in the name the number goes, how long that place is, and how many digits it asks for.
struct Place {
  size_t begin = 0, length = 0;
  int digits = 0;
};

/// The first such place at or after `from`.
std::optional<Place> FindPlace(const std::string& name, size_t from) {
  for (size_t i = from; i < name.size(); ++i) {
    if (name[i] == '#') {
      const size_t end = std::min(name.find_first_not_of('#', i), name.size());
      return Place{i, end - i, static_cast<int>(end - i)};
    }
    if (name[i] == '%') {
      const size_t first = i + 1 + (i + 1 < name.size() && name[i + 1] == '0' ? 1 : 0);
      size_t end = first;
      while (end < name.size() && std::isdigit(static_cast<unsigned char>(name[end])) != 0) {
        ++end;
      }
      if (end < name.size() && name[end] == 'd' && end - first <= 2) {
        return Place{i, end + 1 - i, std::atoi(name.substr(first, end - first).c_str())};
      }
    }
  }
  return std::nullopt;
}

}  // namespace

StatusOr<FramePattern> FramePattern::Parse(const std::string& text) {
  const size_t slash = text.rfind('/');
  const size_t start = slash == std::string::npos ? 0 : slash + 1;
  const std::optional<Place> place = FindPlace(text, start);
  if (!place) {
    return InvalidArgument(
        "'{}' has no place for the frame's number: write it as #### (or %04d), such as f.####.png",
        text);
  }
  if (FindPlace(text, place->begin + place->length)) {
    return InvalidArgument("'{}' has more than one place for the frame's number", text);
  }
  FramePattern pattern;
  pattern.text_ = text;
  pattern.before_ = text.substr(0, place->begin);
  pattern.after_ = text.substr(place->begin + place->length);
  pattern.digits_ = place->digits;
  return pattern;
}

std::string FramePattern::PathOf(int64_t number) const {
  const uint64_t magnitude =
      number < 0 ? uint64_t{0} - static_cast<uint64_t>(number) : static_cast<uint64_t>(number);
  return fmt::format("{}{}{:0{}}{}", before_, number < 0 ? "-" : "", magnitude, digits_, after_);
}

std::string FramePattern::Stem() const {
  const size_t slash = before_.rfind('/');
  std::string stem = slash == std::string::npos ? before_ : before_.substr(slash + 1);
  while (!stem.empty() && (stem.back() == '.' || stem.back() == '_' || stem.back() == '-')) {
    stem.pop_back();
  }
  return stem;
}

}  // namespace fovea::exports
