#ifndef ENGINE_STORE_MERGE_H_
#define ENGINE_STORE_MERGE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/assemble.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"

/// Parts of a series, made on several machines, joined.
namespace fovea::store {

/// The store of part `part` of `parts` of the dataset at `path`: NAME.part-i-of-n.zarr beside
/// NAME.zarr, i from 0. (A path that does not end in .zarr gets the ending all the same.)
[[nodiscard]] std::string PartPath(const std::string& path, int64_t part, int64_t parts);

/// Stores beside `path` that are named as its parts, in no order; may be none.
[[nodiscard]] StatusOr<std::vector<std::string>> FindParts(const std::string& path,
                                                           FileSystem& files = RealFileSystem());

struct MergeOptions {
  std::string path;                // the dataset to make
  std::vector<std::string> parts;  // their paths; empty: those that FindParts finds
  bool remove_parts = false;       // once all is committed
};

struct MergeReport {
  int64_t steps = 0;
  int64_t parts = 0;
  bool was_merged = false;  // before this call
  int64_t parts_removed = 0;
};

/// Joins the parts of one series into `path` and commits all their steps at once. The files of the
/// parts are linked (hard links) where the file system can, else copied, and the parts stay, unless
/// `remove_parts`: so whatever stops it, and whenever, calling it again ends it.
/// NOT_FOUND or FAILED_PRECONDITION naming every part that is not there or not complete;
/// INVALID_ARGUMENT for parts of different series or made differently; ALREADY_EXISTS if `path` is
/// anything but what this merge makes.
[[nodiscard]] StatusOr<MergeReport> Merge(const MergeOptions& options,
                                          const StepProgress& progress = nullptr,
                                          FileSystem& files = RealFileSystem());

/// What differs between how two stores are made ("wavelet", "extent" ...), so that steps of one
/// cannot go into the other; empty if nothing does. Steps, value ranges and parts may differ.
[[nodiscard]] std::string DifferenceInMaking(const DatasetInfo& a, const DatasetInfo& b);

}  // namespace fovea::store

#endif  // ENGINE_STORE_MERGE_H_
