#include "ingest/name_pattern.h"

#include <algorithm>
#include <limits>
#include <set>

namespace fovea::ingest {
namespace {

constexpr size_t kMaxDigits = 18;  // always fits int64
constexpr char kDigits[] = "0123456789";

bool IsDigit(char c) {
  return c >= '0' && c <= '9';
}

struct Run {
  size_t begin = 0, size = 0;
};

std::vector<Run> DigitRuns(const std::string& name) {
  std::vector<Run> runs;
  for (size_t i = name.find_first_of(kDigits); i != std::string::npos;
       i = name.find_first_of(kDigits, i)) {
    const size_t end = std::min(name.find_first_not_of(kDigits, i), name.size());
    runs.push_back({i, end - i});
    i = end;
  }
  return runs;
}

std::optional<int64_t> ParseDigits(const std::string& digits) {
  if (digits.empty() || digits.size() > kMaxDigits ||
      digits.find_first_not_of(kDigits) != std::string::npos) {
    return std::nullopt;
  }
  return std::stoll(digits);
}

/// The run at `position` + %d, %4d or %04d, or nothing.
std::optional<Run> PercentRun(const std::string& name, size_t position) {
  size_t end = position + 1;
  while (end < name.size() && IsDigit(name[end])) {
    ++end;
  }
  if (end >= name.size() || name[end] != 'd' || end - position > 4) {
    return std::nullopt;
  }
  return Run{position, end + 1 - position};
}

/// Where a pattern's numbers stand: runs of # and %d.
std::vector<Run> Placeholders(const std::string& name) {
  std::vector<Run> runs;
  size_t i = 0;
  while (i < name.size()) {
    if (name[i] == '#') {
      const size_t end = std::min(name.find_first_not_of('#', i), name.size());
      runs.push_back({i, end - i});
      i = end;
    } else if (const auto run = name[i] == '%' ? PercentRun(name, i) : std::nullopt) {
      runs.push_back(*run);
      i += run->size;
    } else {
      ++i;
    }
  }
  return runs;
}

/// The number of a file that is alone: smoke_0021.vdb, 21.raw; not that of ct_u8.raw.
std::vector<int64_t> NumberOfSingle(const std::string& name) {
  const size_t dot = name.rfind('.');
  const std::string stem = name.substr(0, dot == 0 ? std::string::npos : dot);
  const std::vector<Run> runs = DigitRuns(stem);
  if (runs.empty() || runs.back().begin + runs.back().size != stem.size()) {
    return {};
  }
  const Run run = runs.back();
  const bool apart =
      run.begin == 0 || std::string("_.-").find(stem[run.begin - 1]) != std::string::npos;
  const auto number = ParseDigits(stem.substr(run.begin));
  return apart && number ? std::vector<int64_t>{*number} : std::vector<int64_t>{};
}

}  // namespace

StatusOr<std::optional<NamePattern>> NamePattern::Parse(const std::string& name) {
  const std::vector<Run> runs = Placeholders(name);
  if (runs.empty()) {
    return std::optional<NamePattern>();
  }
  if (runs.size() > 1) {
    return InvalidArgument("'{}' has {} number patterns; a series has one", name, runs.size());
  }
  const Run run = runs.front();
  NamePattern pattern;
  pattern.prefix_ = name.substr(0, run.begin);
  pattern.suffix_ = name.substr(run.begin + run.size);
  pattern.width_ = run.size;
  if (name[run.begin] == '%') {
    const std::string width = name.substr(run.begin + 1, run.size - 2);
    pattern.width_ = width.empty() ? 1 : std::max<size_t>(1, std::stoul(width));
  }
  return std::optional<NamePattern>(pattern);
}

std::optional<int64_t> NamePattern::Match(const std::string& name) const {
  if (name.size() <= prefix_.size() + suffix_.size() || !name.starts_with(prefix_) ||
      !name.ends_with(suffix_)) {
    return std::nullopt;
  }
  const std::string digits =
      name.substr(prefix_.size(), name.size() - prefix_.size() - suffix_.size());
  const bool padded_too_far = width_ > 1 && digits.size() > width_ && digits.front() == '0';
  if (digits.size() < width_ || padded_too_far) {
    return std::nullopt;
  }
  return ParseDigits(digits);
}

std::string NamePattern::Describe() const {
  return fmt::format("'{}', {} {}, '{}'", prefix_, width_ > 1 ? std::to_string(width_) : "any",
                     width_ > 1 ? "digits or more" : "digits", suffix_);
}

std::vector<int64_t> NumbersThatDiffer(const std::vector<std::string>& names) {
  if (names.size() == 1) {
    return NumberOfSingle(names.front());
  }
  std::vector<std::vector<Run>> runs;
  size_t common = std::numeric_limits<size_t>::max();
  for (const std::string& name : names) {
    runs.push_back(DigitRuns(name));
    common = std::min(common, runs.back().size());
  }
  for (size_t k = 1; k <= common; ++k) {  // k-th run from the end
    std::vector<int64_t> numbers;
    for (size_t i = 0; i < names.size(); ++i) {
      const Run run = runs[i][runs[i].size() - k];
      const auto number = ParseDigits(names[i].substr(run.begin, run.size));
      if (!number) {
        return {};
      }
      numbers.push_back(*number);
    }
    const size_t distinct = std::set<int64_t>(numbers.begin(), numbers.end()).size();
    if (distinct > 1) {
      return distinct == names.size() ? numbers : std::vector<int64_t>{};
    }
  }
  return {};
}

std::string WithNumber(const std::string& name, int64_t from, int64_t to) {
  const std::vector<Run> runs = DigitRuns(name);
  for (auto run = runs.rbegin(); run != runs.rend(); ++run) {
    if (ParseDigits(name.substr(run->begin, run->size)) == from) {
      const bool padded = name[run->begin] == '0' || run->size > 1;
      const std::string digits = fmt::format("{:0{}}", to, padded ? run->size : 1);
      return name.substr(0, run->begin) + digits + name.substr(run->begin + run->size);
    }
  }
  return name;
}

bool NaturalLess(const std::string& a, const std::string& b) {
  size_t i = 0;
  size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (!IsDigit(a[i]) || !IsDigit(b[j])) {
      if (a[i] != b[j]) {
        return a[i] < b[j];
      }
      ++i;
      ++j;
      continue;
    }
    const size_t a_end = std::min(a.find_first_not_of(kDigits, i), a.size());
    const size_t b_end = std::min(b.find_first_not_of(kDigits, j), b.size());
    const size_t a_begin = std::min(a.find_first_not_of('0', i), a_end);
    const size_t b_begin = std::min(b.find_first_not_of('0', j), b_end);
    if (a_end - a_begin != b_end - b_begin) {
      return a_end - a_begin < b_end - b_begin;
    }
    const int order = a.compare(a_begin, a_end - a_begin, b, b_begin, b_end - b_begin);
    if (order != 0) {
      return order < 0;
    }
    i = a_end;
    j = b_end;
  }
  const bool a_ended = i == a.size();
  const bool b_ended = j == b.size();
  return a_ended == b_ended ? a < b : a_ended;
}

}  // namespace fovea::ingest
