#include "ingest/worker/headers/dense_header.h"

#include <cmath>
#include <limits>
#include <set>

#include "engine/volume/hierarchy.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kMaxSteps = 1'000'000;

}  // namespace

namespace {

/// Headers that were not checked yet may say anything: too large is the largest there is.
int64_t Times(int64_t a, int64_t b) {
  int64_t product = 0;
  return __builtin_mul_overflow(a, b, &product) ? std::numeric_limits<int64_t>::max() : product;
}

}  // namespace

int64_t DenseHeader::SizeOf(AxisRole role) const {
  for (const DenseAxis& axis : axes) {
    if (axis.role == role) {
      return axis.size;
    }
  }
  return 1;
}

int64_t DenseHeader::StrideOf(AxisRole role) const {
  int64_t stride = 1;
  for (const DenseAxis& axis : axes) {
    if (axis.role == role) {
      return stride;
    }
    stride = Times(stride, axis.size);
  }
  return 0;
}

Int3 DenseHeader::Dims() const {
  return {SizeOf(AxisRole::kX), SizeOf(AxisRole::kY), SizeOf(AxisRole::kZ)};
}

int64_t DenseHeader::Samples() const {
  int64_t samples = 1;
  for (const DenseAxis& axis : axes) {
    samples = Times(samples, axis.size);
  }
  return samples;
}

bool DenseHeader::IsInOrder() const {
  int64_t stride = 1;
  for (const AxisRole role : {AxisRole::kX, AxisRole::kY, AxisRole::kZ}) {
    if (SizeOf(role) > 1 && StrideOf(role) != stride) {
      return false;
    }
    stride = Times(stride, SizeOf(role));
  }
  return true;
}

Status CheckDenseHeader(const DenseHeader& header) {
  std::set<AxisRole> roles;
  int64_t bytes = BytesOf(header.type);
  for (const DenseAxis& axis : header.axes) {
    const bool spatial = axis.role <= AxisRole::kZ;
    const int64_t most = spatial ? kMaxDimension : kMaxSteps;
    if (axis.size < 1 || axis.size > most) {
      return InvalidArgument("{} {}: 1 to {} can be", axis.size,
                             spatial                           ? "voxels on an axis"
                             : axis.role == AxisRole::kChannel ? "values in a voxel"
                                                               : "time steps",
                             most);
    }
    if (!roles.insert(axis.role).second) {
      return InvalidArgument("two axes of its array mean the same");
    }
    if (__builtin_mul_overflow(bytes, axis.size, &bytes)) {
      return InvalidArgument("its sizes make more bytes than a file can have");
    }
  }
  if (header.data_offset < 0 || header.skip_lines < 0 || header.skip_bytes < 0) {
    return InvalidArgument("a negative number of bytes or lines to skip");
  }
  const double determinant = header.index_to_world.Determinant();
  bool usable = std::isfinite(determinant) && determinant != 0;
  for (const double element : header.index_to_world.m) {
    usable = usable && std::isfinite(element);
  }
  if (!usable) {
    return InvalidArgument("its spacing, directions and origin make no usable transform");
  }
  if (!std::isfinite(header.slope) || header.slope == 0 || !std::isfinite(header.intercept)) {
    return InvalidArgument("values of {} x sample + {} make no sense", header.slope,
                           header.intercept);
  }
  return absl::OkStatus();
}

Matrix4 SpacingMatrix(const Vec3& spacing) {
  Matrix4 matrix;
  for (int axis = 0; axis < 3; ++axis) {
    matrix.m[static_cast<size_t>(5 * axis)] = spacing[axis];
    matrix.m[static_cast<size_t>(4 * axis + 3)] = spacing[axis] / 2;
  }
  return matrix;
}

std::optional<double> SecondsOf(const std::string& unit) {
  if (unit == "s" || unit == "sec" || unit == "second" || unit == "seconds") {
    return 1.0;
  }
  if (unit == "ms" || unit == "msec") {
    return 1e-3;
  }
  if (unit == "us" || unit == "usec") {
    return 1e-6;
  }
  if (unit == "ns") {
    return 1e-9;
  }
  if (unit == "min" || unit == "minutes") {
    return 60.0;
  }
  if (unit == "h" || unit == "hours") {
    return 3600.0;
  }
  return std::nullopt;
}

std::vector<double> RegularTimes(double first, double step, int64_t steps) {
  std::vector<double> times;
  if (!std::isfinite(first) || !std::isfinite(step) || step <= 0 || steps > kMaxSteps) {
    return times;
  }
  for (int64_t i = 0; i < steps; ++i) {
    times.push_back(first + static_cast<double>(i) * step);
  }
  return times;
}

}  // namespace fovea::ingest
