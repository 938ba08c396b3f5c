#ifndef INGEST_WORKER_HEADERS_DENSE_HEADER_H_
#define INGEST_WORKER_HEADERS_DENSE_HEADER_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "ingest/sample_type.h"

/// What the headers of dense voxels have in common. The parsers of this folder are functions from
/// bytes to a DenseHeader: no I/O, no trust, and no memory beyond what the bytes themselves take.
namespace fovea::ingest {

/// What an axis of an array stands for.
enum class AxisRole : uint8_t { kX, kY, kZ, kStep, kChannel };

struct DenseAxis {
  AxisRole role = AxisRole::kX;
  int64_t size = 1;
  friend bool operator==(const DenseAxis&, const DenseAxis&) = default;
};

enum class DataEncoding : uint8_t { kPlain, kDeflate };  // kDeflate: a gzip or zlib stream

struct DenseHeader {
  std::vector<DenseAxis> axes;  // the fastest first; no role twice
  SampleType type = SampleType::kUint8;
  bool big_endian = false;
  double slope = 1, intercept = 0;  // value = slope x sample + intercept
  Matrix4 index_to_world;           // an index is the centre of a voxel
  std::string world_unit, value_unit;
  std::vector<double> times_s;  // one for each step, or none

  DataEncoding encoding = DataEncoding::kPlain;
  /// As the header names them, in order: together they hold the array. Empty: this file does.
  std::vector<std::string> data_files;
  /// In this file: where the data begin. In data files: lines and then bytes to skip in each (of
  /// deflated data: bytes after inflation).
  int64_t data_offset = 0;
  int64_t skip_lines = 0, skip_bytes = 0;
  bool at_end = false;  // the data are the last bytes of the file, whatever stands before
  std::vector<std::string> warnings;

  /// 1 where there is no such axis.
  [[nodiscard]] int64_t SizeOf(AxisRole role) const;
  /// Samples from one index to the next along that axis; 0 where there is no such axis.
  [[nodiscard]] int64_t StrideOf(AxisRole role) const;
  [[nodiscard]] Int3 Dims() const;
  [[nodiscard]] int64_t Samples() const;
  /// Whether a step lies in one piece, x fastest, then y, then z.
  [[nodiscard]] bool IsInOrder() const;
};

/// INVALID_ARGUMENT unless every spatial axis is 1 to kMaxDimension, there are at most a million
/// steps, the bytes fit 63 bits, and every number is finite.
[[nodiscard]] Status CheckDenseHeader(const DenseHeader& header);

/// Voxel centres of voxels of size `spacing` whose first begins at the origin.
[[nodiscard]] Matrix4 SpacingMatrix(const Vec3& spacing);

/// Seconds of one `unit` of time (s, sec, ms, us, min ...), if it is one.
[[nodiscard]] std::optional<double> SecondsOf(const std::string& unit);

/// first + i x step, for each of `steps`; empty if step is not positive or anything is not finite.
[[nodiscard]] std::vector<double> RegularTimes(double first, double step, int64_t steps);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADERS_DENSE_HEADER_H_
