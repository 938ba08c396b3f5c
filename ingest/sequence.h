#ifndef INGEST_SEQUENCE_H_
#define INGEST_SEQUENCE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/ingest.h"

namespace fovea::ingest {

/// One file of a series, in the order of the series.
struct SequenceFile {
  std::string path;
  std::optional<int64_t> frame_number;
  /// OnMissing::kHold: the file of this number is not there, `path` is the one before it.
  bool held = false;
  /// What else is read with it: NAME.raw.json beside NAME.raw; the other slices of a stack.
  std::vector<std::string> further = {};

  /// `path` and `further`: the file set that a worker is given.
  [[nodiscard]] std::vector<std::string> Paths() const;
  friend bool operator==(const SequenceFile&, const SequenceFile&) = default;
};

/// Several pictures (by their extension) are one set, in that order, whose first one is `path`; so
/// are the pictures in a folder, in natural order, and several folders are a series.
///
/// Finds the files that `inputs` stand for: names of files, globs (* ? []), and sequences whose
/// file name has one run of # or one %d or %0Nd where the number is. Two or more # (or %0N) ask for
/// that many digits, or more if the number needs them; a single # and %d take any number of digits.
///
/// Numbers come from the pattern; for globs and lists, from the last run of digits in the file name
/// that differs across the files, if all have one and no two are the same; for a single file, from
/// the digits that end its name (smoke_0021.vdb). Numbered files are in the order of their numbers,
/// others in the order given, globs in natural order (2 before 10).
///
/// The stride of a numbered series is the smallest difference between its numbers. Where a number
/// is missing, kError fails with NOT_FOUND and names the file, kSkip leaves it out, kHold repeats
/// the file before. Nothing found: NOT_FOUND that says what was looked for and where.
[[nodiscard]] StatusOr<std::vector<SequenceFile>> ResolveInputs(
    const std::vector<std::string>& inputs, OnMissing on_missing);

}  // namespace fovea::ingest

#endif  // INGEST_SEQUENCE_H_
