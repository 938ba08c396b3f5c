#ifndef ENGINE_STORE_DATASET_H_
#define ENGINE_STORE_DATASET_H_

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/retained_set.h"
#include "engine/store/file_system.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

namespace fovea::store {

struct FieldInfo {
  std::string name;
  /// Of the stored coefficients: float32; or int16 or int32, which are of the reversible integer
  /// transform, or quantised.
  std::string type = "float32";
  double minimum = 0, maximum = 0;  // data units, over every committed step
  /// Of quantised coefficients: detail of level l is a whole number of `type` times scales[l], and
  /// LLL_0 is float32. Empty: not quantised.
  std::vector<float> scales = {};
  /// Of quantised coefficients: no voxel is to be farther off than this; and how far off the worst
  /// one was found to be, over every committed step. Data units.
  double tolerance = 0, max_error = 0;
  /// Steps of which repair could save nothing, ascending. They read as damaged, or as zeros.
  std::vector<int64_t> lost_steps = {};
  std::string value_unit = {};  // of the values, e.g. "K"; may be empty: unknown
  friend bool operator==(const FieldInfo&, const FieldInfo&) = default;
};

/// A window of detail that is kept where other detail is not: a fovea and its rate, as cubes.
struct RetainedWindow {
  Vec3 at;  // voxel coordinates, 0 to the dimensions
  Rate rate;
  friend bool operator==(const RetainedWindow&, const RetainedWindow&) = default;
};
inline constexpr size_t kMaxRetainedWindows = 64;

/// What series the steps are made of, so that an ingest that was interrupted can go on, and parts
/// made on several machines be joined.
struct SourceInfo {
  std::string series;           // 16 hex digits, the same for the same files read the same way
  int64_t steps = 0;            // of the whole series; 0: not known yet, as new ones are awaited
  int64_t part = 0, parts = 1;  // this store is part `part`, from 0, of `parts`

  /// The steps of the series that this store holds when it is complete: [first, last). Parts are
  /// runs of neighbouring steps, as long as each other or one longer.
  [[nodiscard]] int64_t FirstStep() const { return StepsBefore(part); }
  [[nodiscard]] int64_t LastStep() const { return StepsBefore(part + 1); }
  friend bool operator==(const SourceInfo&, const SourceInfo&) = default;

 private:
  [[nodiscard]] int64_t StepsBefore(int64_t i) const {
    return steps / parts * i + std::min(i, steps % parts);
  }
};

/// The newest format, and the first one in which whole numbers have their signs folded
/// (stored_type.h). Older stores are read, and appended to as they are.
inline constexpr int kFormatVersion = 2;
inline constexpr int kFoldedVersion = 2;

/// The `fovea` attributes of the group (docs/formats/store.md).
struct DatasetInfo {
  int format_version = kFormatVersion;
  std::string wavelet = "haar";           // haar, cdf53 or cdf97
  Hierarchy hierarchy;                    // dims_xyz
  Int3 origin;                            // source index of voxel (0, 0, 0)
  Matrix4 index_to_world;                 // our voxel coordinates to the world
  std::string world_unit;                 // may be empty: unknown
  std::string clock;                      // what time 0 is; may be empty
  std::vector<RetainedWindow> retention;  // empty: all detail is kept
  std::optional<SourceInfo> source;       // where it is known
  int64_t committed_steps = 0;
  std::string default_field;
  std::vector<FieldInfo> fields;
  int64_t chunk_edge = 16;  // detail chunks are [1, 7, c, c, c]: 8, 16 or 32

  /// A field that is there.
  [[nodiscard]] const FieldInfo& FieldOf(const std::string& field) const;
  [[nodiscard]] const std::string& TypeOf(const std::string& field) const {
    return FieldOf(field).type;
  }
  /// Whether repair could save nothing of a step of a field that is there.
  [[nodiscard]] bool IsLost(const std::string& field, int64_t step) const;
};

/// Whether all steps of its source are there; false where that is not known.
[[nodiscard]] bool IsComplete(const DatasetInfo& info);

/// What reading one step cost so far.
struct ReadStats {
  uint64_t chunks_read = 0;
  uint64_t chunks_total = 0;    // stored for this step and field, coarse included
  uint64_t bytes_read = 0;      // compressed, indexes included
  uint64_t chunks_damaged = 0;  // failed their checksum and were read as zeros; each once
  double decode_ms = 0;         // checking and decompressing detail, summed over threads
};

/// What to do when a detail chunk (or the index of its shard) fails its checksum.
enum class OnDamage {
  kFail,   // DATA_LOSS
  kCount,  // read it as zeros, so that the parent super-voxel stands, and count it
};

/// One field of one committed step. Window reads touch only the chunks that meet the window; every
/// checksum on the way is verified: DATA_LOSS names field, step and chunk. A damaged coarse level
/// is always an error; that of a lost step is so with kFail, and otherwise zeros that count as one
/// damaged chunk. Thread-safe.
class StepSource : public CoefficientSource {
 public:
  [[nodiscard]] virtual ReadStats read_stats() const = 0;
};

/// A store opened for reading. Sees the steps that were committed when it was opened or last
/// refreshed; never half a step. Any number of readers beside one writer. Thread-safe.
class Dataset {
 public:
  /// `path` is the NAME.zarr directory. NOT_FOUND if there is none; FAILED_PRECONDITION if it is
  /// not a Fovea store or of a newer format; DATA_LOSS if its metadata is damaged.
  [[nodiscard]] static StatusOr<std::shared_ptr<Dataset>> Open(
      const std::string& path, FileSystem& files = RealFileSystem());
  virtual ~Dataset() = default;

  [[nodiscard]] virtual const std::string& path() const = 0;
  /// The state at the last Open or Refresh.
  [[nodiscard]] virtual DatasetInfo info() const = 0;
  /// Reads committed_steps and value ranges anew.
  [[nodiscard]] virtual Status Refresh() = 0;

  /// All of these: OUT_OF_RANGE for a step that is not committed, NOT_FOUND for an unknown field
  /// (the message lists what there is). Times are nanoseconds, not decreasing.
  [[nodiscard]] virtual StatusOr<int64_t> TimeNs(int64_t step) = 0;
  [[nodiscard]] virtual StatusOr<std::optional<int64_t>> FrameNumber(int64_t step) = 0;
  [[nodiscard]] virtual StatusOr<FieldStats> Stats(int64_t step, const std::string& field) = 0;
  [[nodiscard]] virtual StatusOr<std::unique_ptr<StepSource>> OpenStep(int64_t step,
                                                                       const std::string& field,
                                                                       OnDamage on_damage) = 0;
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_DATASET_H_
