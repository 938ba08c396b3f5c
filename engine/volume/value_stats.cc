#include "engine/volume/value_stats.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace fovea {
namespace {

constexpr size_t kWholeValues = (1 << 15) + (1 << 16);  // -32768 to 65535
constexpr int64_t kWholeZero = 1 << 15;
constexpr size_t kMostUnmerged = size_t{1} << 30;  // 32 bits hold their counts
constexpr int kHistogramBins = 256;

/// A value of the histogram's range to its bin.
class Binning {
 public:
  Binning(double least, double most)
      : least_(least), scale_(most > least ? kHistogramBins / (most - least) : 0) {}
  [[nodiscard]] size_t operator()(double value) const {
    const double bin = std::max((value - least_) * scale_, 0.0);
    return std::min<size_t>(static_cast<size_t>(bin), kHistogramBins - 1);
  }

 private:
  double least_, scale_;
};

/// Whether the values of a word are all the same, as in what surrounds most things.
template <typename T>
bool IsOneValue(const T* values) {
  uint64_t word = 0;
  std::memcpy(&word, values, sizeof(word));
  return word == std::rotl(word, 8 * sizeof(T));
}

}  // namespace

template <typename T>
void ValueStats::CountWhole(std::span<const T> values) {
  constexpr size_t kRange = size_t{1} << (8 * sizeof(T));
  constexpr size_t kTables = sizeof(T) == 1 ? 4 : 2;
  constexpr size_t kPerWord = sizeof(uint64_t) / sizeof(T);
  constexpr int64_t kLeast = std::numeric_limits<T>::min();
  whole_.resize(kWholeValues);
  tables_.resize(kTables * kRange);
  table_least_ = kLeast;
  table_range_ = kRange;
  while (!values.empty()) {
    const std::span<const T> piece = values.first(std::min(values.size(), kMostUnmerged));
    if (unmerged_ + piece.size() > kMostUnmerged) {
      MergeTables();
    }
    unmerged_ += piece.size();
    size_t i = 0;
    for (; i + kPerWord <= piece.size(); i += kPerWord) {
      if (IsOneValue(&piece[i])) {
        tables_[static_cast<size_t>(piece[i] - kLeast)] += kPerWord;
        continue;
      }
      for (size_t k = 0; k < kPerWord; ++k) {
        ++tables_[k % kTables * kRange + static_cast<size_t>(piece[i + k] - kLeast)];
      }
    }
    for (; i < piece.size(); ++i) {
      ++tables_[static_cast<size_t>(piece[i] - kLeast)];
    }
    values = values.subspan(piece.size());
  }
}

void ValueStats::MergeTables() {
  for (size_t i = 0; i < tables_.size(); ++i) {
    const auto value = table_least_ + static_cast<int64_t>(i % table_range_);
    whole_[static_cast<size_t>(value + kWholeZero)] += std::exchange(tables_[i], 0);
  }
  unmerged_ = 0;
}

void ValueStats::Add(std::span<const uint8_t> values) {
  CountWhole(values);
}
void ValueStats::Add(std::span<const int8_t> values) {
  CountWhole(values);
}
void ValueStats::Add(std::span<const uint16_t> values) {
  CountWhole(values);
}
void ValueStats::Add(std::span<const int16_t> values) {
  CountWhole(values);
}

void ValueStats::Add(std::span<const float> values) {
  if (values.empty()) {
    return;
  }
  float least = floats_ > 0 ? least_ : values.front();
  float most = floats_ > 0 ? most_ : values.front();
  for (const float value : values) {
    least = value < least ? value : least;
    most = value > most ? value : most;
  }
  const float only = floats_ > 0 ? least_ : least;
  least_ = least;
  most_ = most;
  floats_ += values.size();
  if (least == most) {
    constants_ += values.size();
    return;
  }
  MakeRoom(least, most);
  if (constants_ > 0) {
    const auto bin = static_cast<int64_t>(std::floor(std::ldexp(only, -exponent_))) - first_;
    fine_[static_cast<size_t>(bin)] += std::exchange(constants_, 0);
  }
  CountFine(values);
}

void ValueStats::AddConstant(float value, uint64_t count) {
  if (count == 0) {
    return;
  }
  if (!whole_.empty()) {
    whole_[static_cast<size_t>(static_cast<int64_t>(value) + kWholeZero)] += count;
    return;
  }
  Add(std::span<const float>(&value, 1));
  floats_ += count - 1;
  if (least_ == most_) {
    constants_ += count - 1;
    return;
  }
  const auto bin = static_cast<int64_t>(std::floor(std::ldexp(value, -exponent_))) - first_;
  fine_[static_cast<size_t>(bin)] += count - 1;
}

void ValueStats::MakeRoom(double least, double most) {
  // As a double: counted in bins that were for small values, a large one is beyond int64_t.
  const auto place = [](double value, int exponent) {
    return std::floor(std::ldexp(value, -exponent));
  };
  const auto bin = [&](double value, int exponent) {
    return static_cast<int64_t>(place(value, exponent));
  };
  const bool is_new = fine_.empty();
  if (!is_new && place(least, exponent_) >= static_cast<double>(first_) &&
      place(most, exponent_) < static_cast<double>(first_ + kBins)) {
    return;
  }
  // The narrowest bins with which the range takes up half of them: between 1/4 and 1/2.
  const int wanted = std::ilogb(most - least) + 1 - std::ilogb(static_cast<double>(kBins / 2));
  const int exponent = is_new ? wanted : std::max(wanted, exponent_);
  const int64_t used = bin(most, exponent) - bin(least, exponent) + 1;
  const int64_t first = bin(least, exponent) - (kBins - used) / 2;
  const int shift = std::min(exponent - exponent_, 63);  // by more, it would be undefined
  std::vector<uint64_t> counts(static_cast<size_t>(kBins));
  for (int64_t i = 0; i < std::ssize(fine_); ++i) {
    if (const uint64_t count = fine_[static_cast<size_t>(i)]; count > 0) {
      const int64_t at = ((first_ + i) >> shift) - first;
      counts[static_cast<size_t>(at)] += count;
    }
  }
  fine_ = std::move(counts);
  first_ = first;
  exponent_ = exponent;
}

void ValueStats::CountFine(std::span<const float> values) {
  const double scale = std::ldexp(1.0, -exponent_);
  const auto first = static_cast<double>(first_);
  uint64_t* const table = fine_.data();
  constexpr int32_t kLast = kBins - 1;
  for (const float value : values) {
    const auto bin = static_cast<int32_t>(static_cast<double>(value) * scale - first);
    ++table[std::clamp(bin, 0, kLast)];
  }
}

FieldStats ValueStats::Finish() {
  FieldStats stats;
  MergeTables();
  if (!whole_.empty()) {
    const auto is_there = [](uint64_t count) { return count > 0; };
    const auto least = std::find_if(whole_.begin(), whole_.end(), is_there) - whole_.begin();
    const auto beyond = whole_.rend() - std::find_if(whole_.rbegin(), whole_.rend(), is_there);
    stats.minimum = static_cast<double>(least - kWholeZero);
    stats.maximum = static_cast<double>(beyond - 1 - kWholeZero);
    const Binning binning(stats.minimum, stats.maximum);
    for (auto i = least; i < beyond; ++i) {
      stats.histogram[binning(static_cast<double>(i - kWholeZero))] +=
          whole_[static_cast<size_t>(i)];
    }
    return stats;
  }
  stats.minimum = least_;
  stats.maximum = most_;
  stats.histogram[0] = constants_;
  const Binning binning(least_, most_);
  const double width = std::ldexp(1.0, exponent_);
  for (int64_t i = 0; i < std::ssize(fine_); ++i) {
    const double middle = (static_cast<double>(first_ + i) + 0.5) * width;
    stats.histogram[binning(middle)] += fine_[static_cast<size_t>(i)];
  }
  return stats;
}

}  // namespace fovea
