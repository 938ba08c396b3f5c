#ifndef INGEST_INGEST_H_
#define INGEST_INGEST_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/retention.h"
#include "engine/volume/basis.h"
#include "engine/volume/geometry.h"

/// Foreign files to a coefficient store. Files are parsed in the worker process (fovea-worker),
/// which only reads and sends sparse blocks; the transform and the store run here.
namespace fovea::ingest {

/// How headerless voxels lie in a file: x fastest, then y, then z.
struct RawFormat {
  Int3 dims;
  std::string type = "uint8";  // a name of SampleType: uint8 ... uint64 int64, float16 to float64
  bool big_endian = false;
  int64_t header_bytes = 0;  // skipped at the start of each file
  int64_t steps_per_file = 1;
  friend bool operator==(const RawFormat&, const RawFormat&) = default;
};

/// Reads 'NXxNYxNZ[xSTEPS]:TYPE[:le|be]', e.g. "256x256x225:uint8" or "103x94x161:uint16:be".
[[nodiscard]] StatusOr<RawFormat> ParseRawFormat(const std::string& text);

/// What to do about a step whose file is not there, or whose file lacks a wanted grid.
enum class OnMissing {
  kError,  // stop, naming the file or grid
  kSkip,   // no step is made of it (a missing grid: of no field of that file)
  kHold,   // the step before stands in for it
};

/// What to do about grids, and steps, whose transforms differ.
enum class Registration {
  kSame,   // stop, saying what differs; grids that lie otherwise from the start are left out
  kIndex,  // voxel i stays voxel i, wherever it lies; the first transform is kept
  kWorld,  // all are brought to the first transform: moved, or resampled
};

/// Limits of the worker process. The memory limit is 512 MB + 3 x the declared bytes unless set.
struct WorkerLimits {
  std::optional<int64_t> memory_bytes;
  double seconds_per_file = 120;  // wall clock; the worker is killed past it
  /// Processor time of all its threads; unless set, the above on every processor.
  std::optional<double> cpu_seconds_per_file;
};

/// How far off a voxel may be that is reconstructed from quantised coefficients.
struct Tolerance {
  double value = 0;       // above 0
  bool relative = false;  // a part of the range of the field's first step; else in data units
};

struct IngestOptions {
  /// Files, globs, or sequences: smoke_####.vdb, smoke_%04d.vdb, 'smoke_*.vdb'. Natural order.
  std::vector<std::string> inputs;
  std::string output;              // NAME.zarr
  std::optional<RawFormat> raw;    // inputs are headerless voxels, and lie so
  std::vector<std::string> grids;  // VDB: which grids, in order; empty: every scalar grid
  std::string field = "density";   // dense files: the name of the one field
  std::optional<Vec3> spacing;     // dense files: voxel size in the world, whatever they say
  std::string channel;             // of several values a voxel: number, name, or luminance
  std::string axes;                // NumPy: a letter of xyztc for each axis of the array
  int64_t slices_per_step = 0;     // pictures; 0: as the files are
  /// When the steps are, in seconds; with neither as the files say, else number / 24.
  std::vector<double> times_s;              // one for each step
  std::optional<double> frames_per_second;  // time of a step = its number / this
  bool append = false;                      // add steps to an existing store
  OnMissing on_missing = OnMissing::kError;
  Registration registration = Registration::kSame;  // VDB
  /// Of a new dataset, in the files' index space; absent: the union of the boxes of all steps.
  std::optional<Box3> extent;
  std::vector<store::AskedWindow>
      retain;  // a new dataset keeps only the detail in these; empty: all
  int64_t chunk_edge = 16;
  std::optional<Wavelet> wavelet;  // default Haar; with `append`, what the store has
  /// Reversible integer coefficients (Haar or CDF 5/3) of raw voxels of 8 bits, stored as int16, or
  /// of 16, stored as int32. With `append`, as the store has it.
  bool lossless = false;
  /// Coefficients quantised so that no voxel is farther off; each step is reconstructed, and the
  /// largest error goes into the store. Not with `lossless`; with `append`, as the store has it.
  std::optional<Tolerance> tolerance;
  int threads = 0;
  WorkerLimits worker;
};

struct IngestReport {
  int64_t steps = 0;         // committed by this call
  int64_t steps_before = 0;  // of the same series, committed by earlier ones
  /// OnMissing: of the series, in which the step before stands in for a file or grid; left out.
  int64_t steps_held = 0, steps_skipped = 0;
  Int3 dims;
  Int3 origin;
  std::vector<std::string> fields;
  std::vector<std::string> warnings;  // what was decided for the user, one line each
  uint64_t input_bytes = 0;
  uint64_t nonfinite_values = 0;   // NaN and infinity, made background
  std::vector<double> max_errors;  // of quantised fields, in the order of `fields`; data units
  double read_ms = 0, transform_ms = 0, write_ms = 0;
};

struct IngestProgress {
  int64_t steps_done = 0, steps_total = 0;
  std::string now;  // the file in hand
};

/// Ingests a whole series: a first pass over the metadata finds fields, extent (the union of the
/// index boxes over all steps) and the matrix; the second reads, transforms and commits step by
/// step. What is committed stays, whatever happens later: the same call again goes on at the first
/// missing step. ALREADY_EXISTS if `output` is there and is not of the same series (DatasetInfo::
/// source), or made otherwise. `progress` returns false to stop cleanly between steps (CANCELLED).
/// Errors name the file and what to do.
[[nodiscard]] StatusOr<IngestReport> Ingest(
    const IngestOptions& options,
    const std::function<bool(const IngestProgress&)>& progress = nullptr);

/// Writes a linear-light picture as .exr (half RGBA, premultiplied) or .tif (float RGBA) through
/// the worker; the file appears whole or not at all.
[[nodiscard]] Status WritePictureFile(const std::string& path, int width, int height,
                                      const std::vector<float>& rgba);

}  // namespace fovea::ingest

#endif  // INGEST_INGEST_H_
