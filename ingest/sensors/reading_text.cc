#include "ingest/sensors/reading_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <limits>
#include <system_error>
#include <utility>

namespace fovea::ingest {

StatusOr<int64_t> StepKeys::NumberOf(std::string_view text) {
  int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  // The least number stands for "no number" in stores.
  const bool is_number = error == std::errc() && end == text.data() + text.size() &&
                         number != std::numeric_limits<int64_t>::min();
  if (kind_ == Kind::kUnknown) {
    kind_ = is_number ? Kind::kNumbers : Kind::kNames;
  }
  if (kind_ == Kind::kNumbers) {
    if (!is_number) {
      return InvalidArgument("the step '{}' is no whole number, as those before are", text);
    }
    return number;
  }
  if (const auto known = names_.find(text); known != names_.end()) {
    return known->second;
  }
  return names_.emplace(text, std::ssize(names_)).first->second;
}

std::unique_ptr<ReadingParser> MakeReadingParser(const ParserOptions& options, std::string name) {
  switch (options.format) {
    case ReadingFormat::kCsv:
      return internal::MakeCsvParser(options, std::move(name));
    case ReadingFormat::kJsonLines:
      return internal::MakeJsonLinesParser(options, std::move(name));
    case ReadingFormat::kRecords:
      break;
  }
  return internal::MakeRecordParser(std::move(name));
}

namespace internal {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

bool IsSpace(char c) {
  return c == ' ' || c == '\t';
}

std::string Lower(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  }
  return lower;
}

/// Exactly `digits` digits at the front of *text, taken off it.
std::optional<int> TakeDigits(std::string_view* text, size_t digits) {
  int value = 0;
  if (text->size() < digits) {
    return std::nullopt;
  }
  for (size_t i = 0; i < digits; ++i) {
    const char c = (*text)[i];
    if (c < '0' || c > '9') {
      return std::nullopt;
    }
    value = 10 * value + (c - '0');
  }
  text->remove_prefix(digits);
  return value;
}

bool TakeChar(std::string_view* text, std::string_view any_of) {
  if (text->empty() || any_of.find(text->front()) == std::string_view::npos) {
    return false;
  }
  text->remove_prefix(1);
  return true;
}

/// "", "Z", "+01", "+0100" or "+01:00" in seconds east of Greenwich.
std::optional<int> ParseZone(std::string_view text) {
  if (text.empty() || text == "Z" || text == "z") {
    return 0;
  }
  const int sign = text.front() == '-' ? -1 : 1;
  if (!TakeChar(&text, "+-")) {
    return std::nullopt;
  }
  const std::optional<int> hours = TakeDigits(&text, 2);
  TakeChar(&text, ":");
  const std::optional<int> minutes = text.empty() ? 0 : TakeDigits(&text, 2);
  if (!hours || !minutes || !text.empty()) {
    return std::nullopt;
  }
  return sign * (*hours * 3600 + *minutes * 60);
}

/// The fraction ".5" at the front of *text, if there is one.
double TakeFraction(std::string_view* text) {
  double fraction = 0;
  if (TakeChar(text, ".,")) {
    for (double unit = 0.1; !text->empty() && text->front() >= '0' && text->front() <= '9';
         unit /= 10) {
      fraction += unit * (text->front() - '0');
      text->remove_prefix(1);
    }
  }
  return fraction;
}

std::optional<double> ParseIsoTime(std::string_view text) {
  const auto year = TakeDigits(&text, 4);
  const bool dash = TakeChar(&text, "-");
  const auto month = TakeDigits(&text, 2);
  const bool dash_again = TakeChar(&text, "-");
  const auto day = TakeDigits(&text, 2);
  if (!year || !dash || !month || !dash_again || !day) {
    return std::nullopt;
  }
  const std::chrono::year_month_day date(std::chrono::year(*year),
                                         std::chrono::month(static_cast<unsigned>(*month)),
                                         std::chrono::day(static_cast<unsigned>(*day)));
  if (!date.ok()) {
    return std::nullopt;
  }
  double seconds =
      86400.0 * static_cast<double>(std::chrono::sys_days(date).time_since_epoch().count());
  if (text.empty()) {
    return seconds;
  }
  const bool at = TakeChar(&text, "Tt ");
  const auto hour = TakeDigits(&text, 2);
  const bool colon = TakeChar(&text, ":");
  const auto minute = TakeDigits(&text, 2);
  if (!at || !hour || !colon || !minute || *hour > 24 || *minute > 59) {
    return std::nullopt;
  }
  seconds += *hour * 3600 + *minute * 60;
  if (TakeChar(&text, ":")) {
    const auto second = TakeDigits(&text, 2);
    if (!second || *second > 60) {
      return std::nullopt;
    }
    seconds += *second + TakeFraction(&text);
  }
  const std::optional<int> zone = ParseZone(text);
  return zone ? std::optional(seconds - *zone) : std::nullopt;
}

/// Names by which a column is known, in lower case and without a unit ("x_m", "t (s)").
constexpr std::array<std::array<std::string_view, 6>, 4> kKnownNames = {{
    {"time", "t", "timestamp", "datetime", "date", "epoch"},
    {"x", "lon", "longitude", "easting", "east", "lng"},
    {"y", "lat", "latitude", "northing", "north", ""},
    {"z", "alt", "altitude", "height", "elevation", "depth"},
}};

/// Without a unit: up to the first '_', ' ', '(', '[' or '/'.
std::string BareName(std::string_view name) {
  return Lower(name.substr(0, std::max<size_t>(1, name.find_first_of("_ ([/"))));
}

std::string Listed(std::span<const std::string> names) {
  std::string text;
  for (size_t i = 0; i < names.size() && i < 32; ++i) {
    text += (i == 0 ? "'" : ", '") + names[i] + "'";
  }
  return names.size() > 32 ? text + " ..." : text;
}

/// The place of the column that was asked for by name or number.
StatusOr<int> FindWanted(const std::string& wanted, std::span<const std::string> names) {
  const auto found = std::find(names.begin(), names.end(), wanted);
  if (found != names.end()) {
    return static_cast<int>(found - names.begin());
  }
  int number = 0;
  const auto [end, error] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), number);
  if (error == std::errc() && end == wanted.data() + wanted.size() && number >= 1 &&
      number <= std::ssize(names)) {
    return number - 1;
  }
  return InvalidArgument("there is no '{}'; there are {} (--columns says which is what)", wanted,
                         Listed(names));
}

int FindKnown(const std::array<std::string_view, 6>& known, std::span<const std::string> names,
              const std::vector<bool>& taken) {
  for (const std::string_view name : known) {
    for (size_t i = 0; i < names.size(); ++i) {
      if (!taken[i] && !name.empty() && BareName(names[i]) == name) {
        return static_cast<int>(i);
      }
    }
  }
  return -1;
}

/// The one column that is called value, or the only one that is left.
StatusOr<int> FindValue(std::span<const std::string> names, const std::vector<bool>& taken) {
  const int known = FindKnown({"value", "v", "val", "reading", "measurement", ""}, names, taken);
  if (known >= 0) {
    return known;
  }
  const auto left = std::count(taken.begin(), taken.end(), false);
  if (left != 1) {
    return InvalidArgument("which of {} is the value? Name it with --columns value=NAME",
                           Listed(names));
  }
  return static_cast<int>(std::find(taken.begin(), taken.end(), false) - taken.begin());
}

}  // namespace

std::string_view Trim(std::string_view text) {
  while (!text.empty() && IsSpace(text.front())) {
    text.remove_prefix(1);
  }
  while (!text.empty() && IsSpace(text.back())) {
    text.remove_suffix(1);
  }
  return text;
}

std::optional<double> ParseReal(std::string_view text) {
  text = Trim(text);
  std::string_view digits = text;
  if (digits.starts_with('+')) {
    digits.remove_prefix(1);
  }
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (end == digits.data() + digits.size() && !digits.empty()) {
    if (error == std::errc()) {
      return value;
    }
    if (error == std::errc::result_out_of_range) {  // too large, or too small to tell from 0
      return digits.find("e-") == std::string_view::npos &&
                     digits.find("E-") == std::string_view::npos
                 ? kNan
                 : 0.0;
    }
  }
  const std::string lower = Lower(text.substr(0, 8));
  if (text.empty() || lower == "na" || lower == "n/a" || lower == "null" || lower == "none") {
    return kNan;
  }
  return std::nullopt;
}

StatusOr<Places> FindPlaces(const ReadingColumns& wanted, std::span<const std::string> names) {
  Places places;
  std::vector<bool> taken(names.size());
  const std::array<const std::string*, kRoles> asked = {&wanted.time, &wanted.x, &wanted.y,
                                                        &wanted.z, &wanted.step};
  for (int role = 0; role < kRoles; ++role) {
    if (!asked[role]->empty()) {
      FOVEA_ASSIGN_OR_RETURN(places.of_role[role], FindWanted(*asked[role], names));
      taken[places.of_role[role]] = true;
    }
  }
  for (const std::string& value : wanted.values) {
    FOVEA_ASSIGN_OR_RETURN(const int place, FindWanted(value, names));
    places.of_value.push_back(place);
    taken[place] = true;
  }
  for (size_t role = 0; role < kKnownNames.size(); ++role) {
    if (places.of_role[role] < 0) {
      places.of_role[role] = FindKnown(kKnownNames[role], names, taken);
      if (places.of_role[role] >= 0) {
        taken[places.of_role[role]] = true;
      }
    }
  }
  for (const Role role : {Role::kX, Role::kY}) {
    if (places.of_role[static_cast<int>(role)] < 0) {
      const char axis = role == Role::kX ? 'x' : 'y';
      return InvalidArgument("which of {} is {}? Name it with --columns {}=NAME", Listed(names),
                             axis, axis);
    }
  }
  if (places.of_value.empty()) {
    FOVEA_ASSIGN_OR_RETURN(const int place, FindValue(names, taken));
    places.of_value.push_back(place);
  }
  return places;
}

Status AppendReading(const Places& places, std::span<const std::string_view> texts,
                     const ParserOptions& options, ReadingBlock* out) {
  const auto text_of = [&](int place) {
    return place < std::ssize(texts) ? texts[place] : std::string_view();
  };
  sensors::Reading reading;
  const std::array<double*, 4> targets = {&reading.time_s, &reading.x, &reading.y, &reading.z};
  for (int role = 0; role < 4; ++role) {
    const int place = places.of_role[role];
    if (place < 0) {
      continue;
    }
    const std::string_view text = text_of(place);
    const std::optional<double> number =
        role == 0 ? ParseTime(text, options.time_unit_s) : ParseReal(text);
    if (!number) {
      return InvalidArgument("'{}' is no {}", text.substr(0, 40), role == 0 ? "time" : "number");
    }
    *targets[role] = *number;
  }
  if (const int place = places.of_role[static_cast<int>(Role::kStep)]; place >= 0) {
    FOVEA_ASSIGN_OR_RETURN(reading.step, options.keys->NumberOf(Trim(text_of(place))));
  }
  const size_t before = out->values.size();
  for (const int place : places.of_value) {
    const std::optional<double> number = ParseReal(text_of(place));
    if (!number) {
      out->values.resize(before);
      return InvalidArgument("'{}' is no number", text_of(place).substr(0, 40));
    }
    out->values.push_back(static_cast<float>(*number));
  }
  out->readings.push_back(reading);
  return absl::OkStatus();
}

Status CountBadLine(const std::string& file, int64_t line, const Status& problem, BadLines* bad) {
  ++bad->count;
  const Status named = Annotate(problem, fmt::format("{}:{}", file, line));
  if (bad->count == 1) {
    bad->first = MessageOf(named);
  }
  if (bad->count <= bad->most) {
    return absl::OkStatus();
  }
  return Annotate(named, bad->most > 0 ? fmt::format("{} bad lines; the last", bad->count)
                                       : "a bad line (--max-bad N bears some)");
}

}  // namespace internal

std::optional<double> ParseTime(std::string_view text, double unit_s) {
  if (const std::optional<double> number = internal::ParseReal(text)) {
    return *number * unit_s;
  }
  return internal::ParseIsoTime(internal::Trim(text));
}

}  // namespace fovea::ingest
