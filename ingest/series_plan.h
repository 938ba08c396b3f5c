#ifndef INGEST_SERIES_PLAN_H_
#define INGEST_SERIES_PLAN_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/volume/geometry.h"
#include "ingest/grid_choice.h"
#include "ingest/ingest.h"

namespace fovea::ingest {

/// Where a field of a step is read from.
struct FieldSource {
  std::string path;
  std::string grid;  // unique name in the file; dense: empty
  int64_t step_in_file = 0;
  size_t file_set = 0;  // in SeriesPlan::file_sets
  friend bool operator==(const FieldSource&, const FieldSource&) = default;
};

struct PlannedStep {
  int64_t time_ns = 0;
  std::optional<int64_t> frame_number;
  std::vector<FieldSource> sources;  // one for each field
};

/// What will be made of a series, known from its metadata alone.
struct SeriesPlan {
  std::vector<std::string> fields;
  /// Of each field, what its values are in the files: uint8 ... float64 of dense files (names of
  /// SampleType; float32 where a slope is applied), float, double, bool ... of VDB; "mixed" if the
  /// files differ.
  std::vector<std::string> source_types;
  std::vector<std::string> value_units;  // of each field; empty: unknown
  std::vector<std::vector<std::string>> file_sets;
  Box3 extent;             // in the files' index space
  Matrix4 index_to_world;  // our voxel coordinates, from extent.lo, to the world
  /// Registration::kWorld: what all grids are brought to, from a voxel's centre in the extent.
  std::optional<Matrix4> lattice;
  std::string world_unit;
  std::vector<PlannedStep> steps;
  int64_t held_steps = 0;      // of `steps`: the one before stands in for a file or a grid
  int64_t skipped_steps = 0;   // left out, since a file or a grid is missing
  int64_t declared_bytes = 0;  // the most that one grid needs in memory
  std::vector<std::string> warnings;
};

/// The store that is appended to, and when its last step is.
struct ExistingStore {
  store::DatasetInfo info;
  int64_t last_time_ns = 0;
};

/// Plans a series from its scanned files, in order. Errors name file and grid and what to do;
/// OUT_OF_RANGE means that the boxes are too large (they may come from wrong metadata).
[[nodiscard]] StatusOr<SeriesPlan> PlanSeries(const IngestOptions& options,
                                              const std::vector<ScannedFile>& files,
                                              const std::optional<ExistingStore>& existing);

}  // namespace fovea::ingest

#endif  // INGEST_SERIES_PLAN_H_
