#ifndef ENGINE_VOLUME_VALUE_STATS_H_
#define ENGINE_VOLUME_VALUE_STATS_H_

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/volume/brick_grid.h"

namespace fovea {

/// Statistics of values that pass once. Of integers of at most 16 bits (all of one type) each value
/// is counted. Of floats the range is not known before the last: they are counted in fine bins,
/// each a power of two wide and at most 1/kFineBins of the range, and these become the 256 bins of
/// the histogram at the end. So its counts add up exactly, and a value can be one bin off if it is
/// less than (maximum - minimum)/kFineBins from the border of two.
/// Not thread-safe.
class ValueStats {
 public:
  static constexpr int64_t kFineBins = 16384;

  void Add(std::span<const uint8_t> values);
  void Add(std::span<const int8_t> values);
  void Add(std::span<const uint16_t> values);
  void Add(std::span<const int16_t> values);
  /// All finite.
  void Add(std::span<const float> values);
  /// The same value `count` times, of the type that came before.
  void AddConstant(float value, uint64_t count);

  /// Of at least one value.
  [[nodiscard]] FieldStats Finish();

 private:
  /// Bins from which kFineBins of the range can be made: twice as many, and room at both ends.
  static constexpr int64_t kBins = 4 * kFineBins;

  /// Makes bins hold least to most: wider ones, or others.
  void MakeRoom(double least, double most);
  void CountFine(std::span<const float> values);
  template <typename T>
  void CountWhole(std::span<const T> values);
  void MergeTables();

  std::vector<uint64_t> whole_;  // by value + 32768; empty: none came
  /// What is not in whole_ yet, in several tables by turns: equal neighbours, which are common, do
  /// not wait for each other.
  std::vector<uint32_t> tables_;
  int64_t table_least_ = 0;     // the value of the first entry
  size_t table_range_ = 1;      // entries of one table
  size_t unmerged_ = 0;         // values counted in the tables
  float least_ = 0, most_ = 0;  // of the floats
  uint64_t floats_ = 0;
  uint64_t constants_ = 0;      // how often least_ came before another value did
  int exponent_ = 0;            // fine bins are 2^exponent_ wide
  int64_t first_ = 0;           // bin 0 begins at first_ * 2^exponent_
  std::vector<uint64_t> fine_;  // kBins, or empty: no two values yet
};

}  // namespace fovea

#endif  // ENGINE_VOLUME_VALUE_STATS_H_
