#include "ingest/raw_format.h"

#include <charconv>
#include <optional>
#include <vector>

#include "engine/volume/hierarchy.h"
#include "ingest/sample_type.h"

namespace fovea::ingest {
namespace {

constexpr char kUsage[] = "expected NXxNYxNZ[xSTEPS]:TYPE[:le|be], e.g. 256x256x225:uint8:le";

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  size_t begin = 0;
  while (true) {
    const size_t end = text.find(separator, begin);
    parts.push_back(text.substr(begin, end - begin));
    if (end == std::string::npos) {
      return parts;
    }
    begin = end + 1;
  }
}

bool ParsePositive(const std::string& text, int64_t* value) {
  const char* end = text.data() + text.size();
  const auto [stopped, error] = std::from_chars(text.data(), end, *value);
  return error == std::errc() && stopped == end && *value > 0;
}

}  // namespace

int64_t BytesPerValue(const std::string& type) {
  const std::optional<SampleType> known = SampleTypeOf(type);
  return known ? BytesOf(*known) : 0;
}

Status CheckRawFormat(const RawFormat& format) {
  if (BytesPerValue(format.type) == 0) {
    return InvalidArgument("raw type '{}' is not known: one of {}", format.type, ListSampleTypes());
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (format.dims[axis] < 1 || format.dims[axis] > kMaxDimension) {
      return InvalidArgument("raw size {} x {} x {}: every axis must be 1 to {} voxels",
                             format.dims.x, format.dims.y, format.dims.z, kMaxDimension);
    }
  }
  if (format.header_bytes < 0) {
    return InvalidArgument("header bytes {}: must not be negative", format.header_bytes);
  }
  if (format.steps_per_file < 1) {
    return InvalidArgument("steps in a file {}: must be at least 1", format.steps_per_file);
  }
  int64_t bytes = 0;  // a step has at most 2^51 bytes, so only the steps can overflow
  if (__builtin_mul_overflow(BytesPerStep(format), format.steps_per_file, &bytes) ||
      __builtin_add_overflow(bytes, format.header_bytes, &bytes)) {
    return InvalidArgument("a raw file of {} is larger than a file can be",
                           DescribeFileSize(format));
  }
  return absl::OkStatus();
}

int64_t BytesPerStep(const RawFormat& format) {
  return format.dims.Product() * BytesPerValue(format.type);
}

int64_t BytesPerFile(const RawFormat& format) {
  return format.header_bytes + format.steps_per_file * BytesPerStep(format);
}

std::string DescribeFileSize(const RawFormat& format) {
  const int64_t bytes = BytesPerValue(format.type);
  return fmt::format("{} header bytes + {} {} x {} x {} x {} voxels x {} {} ({})",
                     format.header_bytes, format.steps_per_file,
                     format.steps_per_file == 1 ? "step" : "steps", format.dims.x, format.dims.y,
                     format.dims.z, bytes, bytes == 1 ? "byte" : "bytes", format.type);
}

StatusOr<RawFormat> ParseRawFormat(const std::string& text) {
  const std::vector<std::string> parts = Split(text, ':');
  if (parts.size() < 2 || parts.size() > 3) {
    return InvalidArgument("raw format '{}': {}", text, kUsage);
  }
  const std::vector<std::string> sizes = Split(parts[0], 'x');
  RawFormat format;
  format.type = parts[1];
  if (sizes.size() < 3 || sizes.size() > 4 || !ParsePositive(sizes[0], &format.dims.x) ||
      !ParsePositive(sizes[1], &format.dims.y) || !ParsePositive(sizes[2], &format.dims.z) ||
      (sizes.size() == 4 && !ParsePositive(sizes[3], &format.steps_per_file))) {
    return InvalidArgument("raw format '{}': size '{}' is not understood; {}", text, parts[0],
                           kUsage);
  }
  if (parts.size() == 3 && parts[2] != "le" && parts[2] != "be") {
    return InvalidArgument("raw format '{}': byte order '{}' is neither le nor be", text, parts[2]);
  }
  format.big_endian = parts.size() == 3 && parts[2] == "be";
  FOVEA_RETURN_IF_ERROR(CheckRawFormat(format));
  return format;
}

}  // namespace fovea::ingest
