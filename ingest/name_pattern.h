#ifndef INGEST_NAME_PATTERN_H_
#define INGEST_NAME_PATTERN_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"

/// Numbers in file names (no folders).
namespace fovea::ingest {

/// A file name with one number in it: smoke_####.vdb, smoke_%04d.vdb.
class NamePattern {
 public:
  /// Nothing if `name` holds neither a run of # nor a %d; INVALID_ARGUMENT if it holds several.
  [[nodiscard]] static StatusOr<std::optional<NamePattern>> Parse(const std::string& name);

  /// The number of `name`, if it fits. Numbers are at most 18 digits long.
  [[nodiscard]] std::optional<int64_t> Match(const std::string& name) const;
  /// What Match looks for, in words.
  [[nodiscard]] std::string Describe() const;

 private:
  std::string prefix_, suffix_;
  size_t width_ = 1;  // digits at least; 1: any
};

/// For each name its number: the last run of digits that differs across the names (counted from the
/// end of the names), or of a single name the digits before its extension, when '_', '.' or '-' or
/// nothing stands before them. Empty if some name has no such number or two have the same.
[[nodiscard]] std::vector<int64_t> NumbersThatDiffer(const std::vector<std::string>& names);

/// `name` with the last run of digits that reads `from` replaced by `to`, padded alike.
[[nodiscard]] std::string WithNumber(const std::string& name, int64_t from, int64_t to);

/// Less in natural order: runs of digits compare as numbers, all else as bytes.
[[nodiscard]] bool NaturalLess(const std::string& a, const std::string& b);

}  // namespace fovea::ingest

#endif  // INGEST_NAME_PATTERN_H_
