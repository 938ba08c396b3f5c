#include <algorithm>
#include <utility>

#include "ingest/sensors/reading_text.h"

namespace fovea::ingest::internal {
namespace {

constexpr int kMostDepth = 64;
constexpr size_t kMostKeys = 1024;

/// One JSON object of a line: its keys, and its values as texts (strings without their quotes).
/// Values that are objects or arrays are passed over. Strict where it matters, lenient in numbers:
/// whatever stands there is read as a number later.
class FlatObject {
 public:
  Status Parse(std::string_view line) {
    rest_ = line;
    keys_.clear();
    values_.clear();
    SkipSpace();
    if (!Take('{')) {
      return InvalidArgument("a line must be one JSON object, {{\"x\": 1, ...}}");
    }
    SkipSpace();
    if (!Take('}')) {
      do {
        FOVEA_RETURN_IF_ERROR(Member());
      } while (Take(','));
      if (!Take('}')) {
        return InvalidArgument("a comma or a closing brace is missing");
      }
    }
    SkipSpace();
    return rest_.empty() ? absl::OkStatus()
                         : InvalidArgument("there is text behind the JSON object");
  }
  [[nodiscard]] const std::vector<std::string>& keys() const { return keys_; }
  [[nodiscard]] const std::vector<std::string>& values() const { return values_; }

 private:
  void SkipSpace() {
    while (!rest_.empty() && (rest_.front() == ' ' || rest_.front() == '\t')) {
      rest_.remove_prefix(1);
    }
  }
  bool Take(char c) {
    if (rest_.empty() || rest_.front() != c) {
      return false;
    }
    rest_.remove_prefix(1);
    return true;
  }

  Status Member() {
    SkipSpace();
    std::string key, value;
    FOVEA_RETURN_IF_ERROR(String(&key));
    SkipSpace();
    if (!Take(':')) {
      return InvalidArgument("a colon is missing behind \"{}\"", key.substr(0, 40));
    }
    SkipSpace();
    bool flat = true;
    if (!rest_.empty() && rest_.front() == '"') {
      FOVEA_RETURN_IF_ERROR(String(&value));
    } else if (!rest_.empty() && (rest_.front() == '{' || rest_.front() == '[')) {
      flat = false;
      FOVEA_RETURN_IF_ERROR(SkipNested());
    } else {
      const size_t end = std::min(rest_.find_first_of(",} \t"), rest_.size());
      if (end == 0) {
        return InvalidArgument("there is no value behind \"{}\"", key.substr(0, 40));
      }
      value = rest_.substr(0, end);
      rest_.remove_prefix(end);
    }
    SkipSpace();
    return flat ? Keep(std::move(key), std::move(value)) : absl::OkStatus();
  }

  /// Of a key that comes twice, the last stands.
  Status Keep(std::string key, std::string value) {
    const auto known = std::find(keys_.begin(), keys_.end(), key);
    if (known != keys_.end()) {
      values_[static_cast<size_t>(known - keys_.begin())] = std::move(value);
      return absl::OkStatus();
    }
    if (keys_.size() == kMostKeys) {
      return InvalidArgument("an object of more than {} keys", kMostKeys);
    }
    keys_.push_back(std::move(key));
    values_.push_back(std::move(value));
    return absl::OkStatus();
  }

  Status String(std::string* text) {
    if (!Take('"')) {
      return InvalidArgument("a quote is missing");
    }
    while (!rest_.empty()) {
      const char c = rest_.front();
      rest_.remove_prefix(1);
      if (c == '"') {
        return absl::OkStatus();
      }
      if (c != '\\') {
        *text += c;
        continue;
      }
      FOVEA_RETURN_IF_ERROR(Escape(text));
    }
    return InvalidArgument("a quote is not closed");
  }

  Status Escape(std::string* text) {
    constexpr std::string_view kNames = "\"\\/bfnrt";
    constexpr std::string_view kMeanings = "\"\\/\b\f\n\r\t";
    if (rest_.empty()) {
      return InvalidArgument("a quote is not closed");
    }
    const char c = rest_.front();
    rest_.remove_prefix(1);
    if (const size_t known = kNames.find(c); known != std::string_view::npos) {
      *text += kMeanings[known];
      return absl::OkStatus();
    }
    if (c != 'u' || rest_.size() < 4) {
      return InvalidArgument("\\{} is no escape of JSON", c >= ' ' && c <= '~' ? c : '?');
    }
    // Only texts that name steps may hold these: as they are written, they are as good a name.
    *text += "\\u";
    *text += rest_.substr(0, 4);
    rest_.remove_prefix(4);
    return absl::OkStatus();
  }

  Status SkipNested() {
    int depth = 0;
    std::string ignored;
    do {
      if (rest_.empty()) {
        return InvalidArgument("a bracket is not closed");
      }
      const char c = rest_.front();
      if (c == '"') {
        FOVEA_RETURN_IF_ERROR(String(&ignored));
        continue;
      }
      rest_.remove_prefix(1);
      depth += c == '{' || c == '[' ? 1 : c == '}' || c == ']' ? -1 : 0;
      if (depth > kMostDepth) {
        return InvalidArgument("brackets are nested more than {} deep", kMostDepth);
      }
    } while (depth > 0);
    return absl::OkStatus();
  }

  std::string_view rest_;
  std::vector<std::string> keys_, values_;
};

class JsonLinesParser final : public ReadingParser {
 public:
  JsonLinesParser(const ParserOptions& options, std::string name)
      : options_(options), name_(std::move(name)) {}

  StatusOr<size_t> Parse(std::string_view bytes, bool last, ReadingBlock* out) override {
    return ForEachLine(bytes, last, name_, &line_,
                       [&](std::string_view line) { return TakeLine(line, out); });
  }
  const std::vector<std::string>& value_names() const override { return value_names_; }

 private:
  Status TakeLine(std::string_view line, ReadingBlock* out) {
    if (Trim(line).empty()) {
      return absl::OkStatus();
    }
    Status status = object_.Parse(line);
    if (status.ok() && !started_) {
      FOVEA_RETURN_IF_ERROR(Start());
    }
    if (status.ok()) {
      Arrange();
      status = AppendReading(places_, texts_, options_, out);
    }
    return status.ok() ? status : CountBadLine(name_, line_, status, options_.bad);
  }

  /// The first object says which keys there are.
  Status Start() {
    StatusOr<Places> places = FindPlaces(options_.columns, object_.keys());
    if (!places.ok()) {
      return Annotate(places.status(), fmt::format("{}:{}", name_, line_));
    }
    places_ = *std::move(places);
    names_ = object_.keys();
    for (const int place : places_.of_value) {
      value_names_.push_back(names_[place]);
    }
    started_ = true;
    return absl::OkStatus();
  }

  /// The values in the order of the first object; what is missing is empty.
  void Arrange() {
    const auto& keys = object_.keys();
    texts_.assign(names_.size(), {});
    for (size_t i = 0; i < names_.size(); ++i) {
      const bool as_before = i < keys.size() && keys[i] == names_[i];
      const auto found = as_before ? keys.begin() + static_cast<std::ptrdiff_t>(i)
                                   : std::find(keys.begin(), keys.end(), names_[i]);
      if (found != keys.end()) {
        texts_[i] = object_.values()[static_cast<size_t>(found - keys.begin())];
      }
    }
  }

  const ParserOptions options_;
  const std::string name_;
  int64_t line_ = 0;
  bool started_ = false;
  Places places_;
  FlatObject object_;
  std::vector<std::string> names_, value_names_;
  std::vector<std::string_view> texts_;
};

}  // namespace

std::unique_ptr<ReadingParser> MakeJsonLinesParser(const ParserOptions& options, std::string name) {
  return std::make_unique<JsonLinesParser>(options, std::move(name));
}

}  // namespace fovea::ingest::internal
