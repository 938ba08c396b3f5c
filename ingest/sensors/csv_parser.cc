#include <algorithm>
#include <deque>
#include <utility>

#include "ingest/sensors/reading_text.h"

namespace fovea::ingest::internal {
namespace {

/// The fields of one line. Quoted ones lose their quotes; two quotes inside stand for one.
class Fields {
 public:
  Status Split(std::string_view line, char separator) {
    texts_.clear();
    unquoted_.clear();
    for (size_t at = 0;;) {
      while (at < line.size() && line[at] == ' ') {
        ++at;
      }
      if (at < line.size() && line[at] == '"') {
        FOVEA_ASSIGN_OR_RETURN(at, TakeQuoted(line, at + 1));
        while (at < line.size() && line[at] == ' ') {
          ++at;
        }
        if (at < line.size() && line[at] != separator) {
          return InvalidArgument("there is text behind a closing quote");
        }
      } else {
        const size_t end = std::min(line.find(separator, at), line.size());
        texts_.push_back(Trim(line.substr(at, end - at)));
        at = end;
      }
      if (at >= line.size()) {
        return absl::OkStatus();
      }
      ++at;
    }
  }
  [[nodiscard]] const std::vector<std::string_view>& texts() const { return texts_; }

 private:
  /// From behind the opening quote; returns the place behind the closing one.
  StatusOr<size_t> TakeQuoted(std::string_view line, size_t at) {
    std::string text;
    for (; at < line.size(); ++at) {
      if (line[at] != '"') {
        text += line[at];
      } else if (at + 1 < line.size() && line[at + 1] == '"') {
        text += line[at++];
      } else {
        unquoted_.push_back(std::move(text));  // a deque: the views stay good
        texts_.push_back(unquoted_.back());
        return at + 1;
      }
    }
    return InvalidArgument("a quote is not closed on its line");
  }

  std::vector<std::string_view> texts_;
  std::deque<std::string> unquoted_;
};

/// Tab if there is one, then semicolon, else comma.
char SeparatorOf(std::string_view line) {
  for (const char c : {'\t', ';'}) {
    if (line.find(c) != std::string_view::npos) {
      return c;
    }
  }
  return ',';
}

bool IsReal(std::string_view text, double unit_s) {
  return !text.empty() && (ParseReal(text) || ParseTime(text, unit_s));
}

class CsvParser final : public ReadingParser {
 public:
  CsvParser(const ParserOptions& options, std::string name)
      : options_(options), name_(std::move(name)), separator_(options.separator) {}

  StatusOr<size_t> Parse(std::string_view bytes, bool last, ReadingBlock* out) override {
    return ForEachLine(bytes, last, name_, &line_,
                       [&](std::string_view line) { return TakeLine(line, out); });
  }
  const std::vector<std::string>& value_names() const override { return value_names_; }

 private:
  Status TakeLine(std::string_view line, ReadingBlock* out) {
    if (line_ == 1 && line.starts_with("\xef\xbb\xbf")) {  // what some write in front of UTF-8
      line.remove_prefix(3);
    }
    if (const std::string_view text = Trim(line); text.empty() || text.front() == '#') {
      return absl::OkStatus();
    }
    if (separator_ == 0) {
      separator_ = SeparatorOf(line);
    }
    Status status = fields_.Split(line, separator_);
    if (status.ok() && !started_) {
      FOVEA_ASSIGN_OR_RETURN(const bool is_header, Start());
      if (is_header) {
        return absl::OkStatus();
      }
    }
    if (status.ok() && std::ssize(fields_.texts()) < columns_) {
      status =
          InvalidArgument("there are {} fields instead of {}", fields_.texts().size(), columns_);
    }
    if (status.ok()) {
      status = AppendReading(places_, fields_.texts(), options_, out);
    }
    return status.ok() ? status : CountBadLine(name_, line_, status, options_.bad);
  }

  /// From the first line; whether that is a header: a field of it is neither number nor time.
  StatusOr<bool> Start() {
    const auto& texts = fields_.texts();
    const bool is_header = std::any_of(texts.begin(), texts.end(), [&](std::string_view text) {
      return !IsReal(text, options_.time_unit_s);
    });
    std::vector<std::string> names(texts.begin(), texts.end());
    if (!is_header) {
      FOVEA_RETURN_IF_ERROR(NameByNumber(&names));
    }
    StatusOr<Places> places = FindPlaces(options_.columns, names);
    if (!places.ok()) {
      return Annotate(places.status(), fmt::format("{}:{}", name_, line_));
    }
    places_ = *std::move(places);
    for (const int place : places_.of_value) {
      value_names_.push_back(names[place]);
    }
    columns_ = 0;
    for (const auto& some :
         {std::vector<int>(places_.of_role.begin(), places_.of_role.end()), places_.of_value}) {
      for (const int place : some) {
        columns_ = std::max<std::ptrdiff_t>(columns_, place + 1);
      }
    }
    started_ = true;
    return is_header;
  }

  /// Without a header: x, y, z, t, value if there are five columns, else by --columns alone.
  Status NameByNumber(std::vector<std::string>* names) const {
    const ReadingColumns& columns = options_.columns;
    const bool nothing_asked = columns.time.empty() && columns.x.empty() && columns.y.empty() &&
                               columns.z.empty() && columns.step.empty() && columns.values.empty();
    if (nothing_asked && names->size() == 5) {
      *names = {"x", "y", "z", "t", "value"};
      return absl::OkStatus();
    }
    if (columns.x.empty() || columns.y.empty() || columns.values.empty()) {
      return InvalidArgument(
          "{}:{}: no header names the {} columns: number them, --columns "
          "time=1,x=2,y=3,z=4,value=5",
          name_, line_, names->size());
    }
    for (size_t i = 0; i < names->size(); ++i) {
      (*names)[i] = fmt::format("{}", i + 1);
    }
    return absl::OkStatus();
  }

  const ParserOptions options_;
  const std::string name_;
  char separator_;
  int64_t line_ = 0;
  bool started_ = false;
  Places places_;
  std::ptrdiff_t columns_ = 0;  // at least so many fields must be there
  Fields fields_;
  std::vector<std::string> value_names_;
};

}  // namespace

std::unique_ptr<ReadingParser> MakeCsvParser(const ParserOptions& options, std::string name) {
  return std::make_unique<CsvParser>(options, std::move(name));
}

}  // namespace fovea::ingest::internal
