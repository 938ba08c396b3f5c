#ifndef ENGINE_STORE_REPAIR_SERIES_H_
#define ENGINE_STORE_REPAIR_SERIES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"
#include "engine/store/layout.h"
#include "engine/store/repair.h"
#include "engine/store/repair_target.h"

namespace fovea::store {

/// Repairs the arrays that have a row a step. Look writes down what is wrong; Write then mends it,
/// once the coefficients are where they will be. Not thread-safe.
class SeriesRepair {
 public:
  SeriesRepair(FileSystem& files, std::string store_path, RepairTarget* target)
      : files_(files), path_(std::move(store_path)), target_(target) {}

  /// Keeps what is sound. An error only if something cannot be read for want of rights or
  /// descriptors.
  [[nodiscard]] Status Look(const DatasetInfo& info, RepairReport* report);
  /// Times between those that are known, no frame numbers, statistics from the coefficients in the
  /// target. `info` tells the steps that are lost: their statistics are 0.
  [[nodiscard]] Status Write(const DatasetInfo& info);
  [[nodiscard]] bool Changes() const { return !damaged_.empty(); }
  /// Least and greatest value in all sound rows of a field's statistics; 0 and 0 if there is none.
  [[nodiscard]] StatusOr<FieldInfo> Range(const FieldInfo& field, int64_t steps) const;

 private:
  struct Damaged {
    ArraySpec array;
    std::string field;
    int64_t chunk = 0;  // along t
  };

  [[nodiscard]] Status LookAt(const ArraySpec& array, const std::string& field, int64_t steps,
                              RepairReport* report);
  /// Those that are known, and between them what fits.
  [[nodiscard]] StatusOr<std::vector<int64_t>> Times(int64_t steps) const;
  [[nodiscard]] Status WriteTimes(const ArraySpec& array, int64_t chunk, int64_t steps);
  [[nodiscard]] Status WriteStatistics(const DatasetInfo& info, const FieldInfo& field,
                                       const Damaged& damaged);
  [[nodiscard]] StatusOr<FieldStats> Compute(const DatasetInfo& info, const FieldInfo& field,
                                             int64_t step) const;

  FileSystem& files_;
  const std::string path_;
  RepairTarget* const target_;
  std::vector<Damaged> damaged_;
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_REPAIR_SERIES_H_
