#include "service/wire/readings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string_view>

#include "service/wire/printable.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr double kLatest = 9.2e9;
constexpr double kMaxDimension = 65536;
constexpr int kMaxFields = 64;
constexpr uint64_t kMostWindowsAhead = 10'000;
constexpr uint64_t kMaxReach = uint64_t{1} << 40;
constexpr size_t kMaxUnitBytes = 64, kMaxClockBytes = 256;
constexpr size_t kMaxNameParts = 16, kMaxPartBytes = 255;
/// A time, a place, and its values; and all else of a message.
constexpr int64_t kReadingBytes = 4 * 8;
constexpr int64_t kOtherBytes = 256;

bool IsName(std::string_view text) {
  return !text.empty() && text.size() <= kMaxPartBytes && text.front() != '.' &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
                  c == '_' || c == '.' || c == '-';
         });
}

Status CheckNumber(const char* path, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    return BadField(path, fmt::format("{} is outside {} to {}", value, low, high));
  }
  return absl::OkStatus();
}

Status CheckText(const char* path, const std::string& text, size_t most) {
  if (text.size() > most) {
    return BadField(path, fmt::format("has {} bytes, more than {}", text.size(), most));
  }
  return absl::OkStatus();
}

Vec3 VecOf(const v1::Vec3& proto) {
  return {proto.x(), proto.y(), proto.z()};
}

StatusOr<std::optional<sensors::VoxelGrid>> GridOf(const v1::ReadingsHeader& proto) {
  if (!proto.has_lower() && !proto.has_upper() && !proto.has_voxel()) {
    return std::optional<sensors::VoxelGrid>();
  }
  if (!proto.has_lower() || !proto.has_upper() || !proto.has_voxel()) {
    return BadField(!proto.has_lower()   ? "header.lower"
                    : !proto.has_upper() ? "header.upper"
                                         : "header.voxel",
                    "is missing: lower, upper and voxel go together");
  }
  sensors::VoxelGrid grid;
  grid.lower = VecOf(proto.lower());
  grid.voxel = VecOf(proto.voxel());
  const Vec3 upper = VecOf(proto.upper());
  Int3 dims;
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(grid.lower[axis])) {
      return BadField("header.lower", fmt::format("{} is not finite", grid.lower[axis]));
    }
    const double size = upper[axis] - grid.lower[axis];
    if (!(size >= 0) || !std::isfinite(size)) {
      return BadField("header.upper", fmt::format("{} is not finite, or below header.lower, {}",
                                                  upper[axis], grid.lower[axis]));
    }
    const double count = size / grid.voxel[axis];
    if (!(grid.voxel[axis] > 0) || !std::isfinite(grid.voxel[axis]) || !(count <= kMaxDimension)) {
      return BadField("header.voxel",
                      fmt::format("{} along {} does not make 1 to {} voxels of a box of {}",
                                  grid.voxel[axis], "xyz"[axis], kMaxDimension, size));
    }
    // The last voxel may be cut; rounding must not make one more.
    dims[axis] = std::max<int64_t>(1, static_cast<int64_t>(std::ceil(count - 1e-6)));
  }
  auto hierarchy = Hierarchy::Make(dims);
  if (!hierarchy.ok()) {
    return BadField("header.voxel", MessageOf(hierarchy.status()));
  }
  grid.hierarchy = *std::move(hierarchy);
  return std::optional(grid);
}

Status TakeFields(const v1::ReadingsHeader& proto, ReadingsSpec* spec) {
  if (proto.fields_size() > kMaxFields) {
    return BadField("header.fields",
                    fmt::format("{} names are more than {}", proto.fields_size(), kMaxFields));
  }
  std::set<std::string> seen = {"coverage"};
  for (const std::string& field : proto.fields()) {
    if (!IsName(field) || !seen.insert(field).second) {
      return BadField(
          "header.fields",
          fmt::format("'{}' is not of [A-Za-z0-9_.-], begins with '.', or is there twice "
                      "('coverage' is one that is always there)",
                      Printable(field)));
    }
    spec->fields.push_back(field);
  }
  return absl::OkStatus();
}

Status TakeSteps(const v1::ReadingsHeader& proto, sensors::StepRule* steps) {
  constexpr double kShortest = 1e-9;
  FOVEA_RETURN_IF_ERROR(
      CheckNumber("header.step_seconds", proto.step_seconds(), kShortest, kLatest));
  FOVEA_RETURN_IF_ERROR(
      CheckNumber("header.start_seconds", proto.start_seconds(), -kLatest, kLatest));
  FOVEA_RETURN_IF_ERROR(
      CheckNumber("header.watermark_seconds", proto.watermark_seconds(), 0, kLatest));
  steps->window_s = proto.step_seconds();
  steps->start_s = proto.start_seconds();
  steps->watermark_s = proto.watermark_seconds();
  if (proto.has_most_ahead()) {
    if (proto.most_ahead() < 1 || proto.most_ahead() > kMostWindowsAhead) {
      return BadField("header.most_ahead",
                      fmt::format("{} is outside 1 to {}", proto.most_ahead(), kMostWindowsAhead));
    }
    steps->most_ahead = static_cast<int64_t>(proto.most_ahead());
  }
  if (!v1::ReadingsHeader::OnMissing_IsValid(proto.on_missing())) {
    return BadField("header.on_missing", fmt::format("{} is none", proto.on_missing()));
  }
  steps->on_empty = proto.on_missing() == v1::ReadingsHeader::HOLD ? sensors::OnEmpty::kHold
                                                                   : sensors::OnEmpty::kSkip;
  return absl::OkStatus();
}

Status TakeValues(const v1::ReadingsHeader& proto, ReadingsSpec* spec) {
  if (!v1::ReadingsHeader::Duplicates_IsValid(proto.duplicates())) {
    return BadField("header.duplicates", fmt::format("{} is none", proto.duplicates()));
  }
  if (proto.duplicates() == v1::ReadingsHeader::MEAN) {
    spec->duplicates = sensors::Duplicates::kMean;
  }
  if (proto.has_least_value()) {
    spec->least_value = proto.least_value();
  }
  if (proto.has_greatest_value()) {
    spec->greatest_value = proto.greatest_value();
  }
  if (!(spec->least_value <= spec->greatest_value)) {
    return BadField("header.greatest_value", fmt::format("{} is below least_value, {}",
                                                         spec->greatest_value, spec->least_value));
  }
  if (proto.has_reach_voxels()) {
    if (proto.reach_voxels() < 1 || proto.reach_voxels() > kMaxReach) {
      return BadField("header.reach_voxels",
                      fmt::format("{} is outside 1 to {}", proto.reach_voxels(), kMaxReach));
    }
    spec->fill.reach_voxels = static_cast<int64_t>(proto.reach_voxels());
  }
  FOVEA_RETURN_IF_ERROR(CheckNumber("header.background", proto.background(),
                                    -sensors::kLargestValue, sensors::kLargestValue));
  spec->fill.background = proto.background();
  return absl::OkStatus();
}

Status CheckLength(const char* path, int there, int wanted, bool optional) {
  if (there == wanted || (optional && there == 0)) {
    return absl::OkStatus();
  }
  return BadField(path,
                  fmt::format("has {} numbers where time_ns and fields ask for {}", there, wanted));
}

}  // namespace

bool IsNewDatasetName(const std::string& name) {
  size_t parts = 0;
  for (size_t at = 0; at <= name.size();) {
    const size_t end = std::min(name.find('/', at), name.size());
    const std::string_view part = std::string_view(name).substr(at, end - at);
    if (!IsName(part) || part.ends_with(".zarr") || ++parts > kMaxNameParts) {
      return false;
    }
    at = end + 1;
  }
  return true;
}

StatusOr<ReadingsSpec> FromProto(const v1::ReadingsHeader& proto) {
  ReadingsSpec spec;
  if (!IsNewDatasetName(proto.dataset())) {
    return BadField("header.dataset",
                    fmt::format("'{}' is not 1 to {} parts of [A-Za-z0-9_.-] between slashes, none "
                                "beginning with '.' or ending in '.zarr'",
                                Printable(proto.dataset()), kMaxNameParts));
  }
  spec.dataset = proto.dataset();
  if (!v1::ReadingsHeader::Durability_IsValid(proto.durability())) {
    return BadField("header.durability", fmt::format("{} is none", proto.durability()));
  }
  spec.acknowledge_received = proto.durability() == v1::ReadingsHeader::RECEIVED;
  FOVEA_RETURN_IF_ERROR(TakeFields(proto, &spec));
  FOVEA_ASSIGN_OR_RETURN(spec.grid, GridOf(proto));
  FOVEA_RETURN_IF_ERROR(TakeSteps(proto, &spec.steps));
  FOVEA_RETURN_IF_ERROR(TakeValues(proto, &spec));
  FOVEA_RETURN_IF_ERROR(CheckText("header.world_unit", proto.world_unit(), kMaxUnitBytes));
  FOVEA_RETURN_IF_ERROR(CheckText("header.value_unit", proto.value_unit(), kMaxUnitBytes));
  FOVEA_RETURN_IF_ERROR(CheckText("header.clock", proto.clock(), kMaxClockBytes));
  spec.world_unit = proto.world_unit();
  spec.value_unit = proto.value_unit();
  spec.clock = proto.clock();
  if (proto.has_chunk_edge()) {
    spec.chunk_edge = proto.chunk_edge();
    if (spec.chunk_edge != 8 && spec.chunk_edge != 16 && spec.chunk_edge != 32) {
      return BadField("header.chunk_edge", fmt::format("{} is not 8, 16 or 32", spec.chunk_edge));
    }
  }
  return spec;
}

StatusOr<ReadingBatch> FromProto(const v1::ReadingBatch& proto, int fields) {
  if (proto.sequence() == 0) {
    return BadField("batch.sequence", "is 0: batches count from 1");
  }
  const int count = proto.time_ns_size();
  FOVEA_RETURN_IF_ERROR(CheckLength("batch.x", proto.x_size(), count, false));
  FOVEA_RETURN_IF_ERROR(CheckLength("batch.y", proto.y_size(), count, true));
  FOVEA_RETURN_IF_ERROR(CheckLength("batch.z", proto.z_size(), count, true));
  FOVEA_RETURN_IF_ERROR(CheckLength("batch.value", proto.value_size(), count * fields, false));
  ReadingBatch batch;
  batch.sequence = proto.sequence();
  batch.last = proto.last();
  if (proto.has_complete_before_ns()) {
    batch.complete_before_ns = proto.complete_before_ns();
  }
  batch.readings.resize(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) {
    sensors::Reading& reading = batch.readings[static_cast<size_t>(i)];
    reading.x = proto.x(i);
    reading.y = proto.y_size() > 0 ? proto.y(i) : 0;
    reading.z = proto.z_size() > 0 ? proto.z(i) : 0;
    reading.time_s = static_cast<double>(proto.time_ns(i)) / 1e9;
  }
  batch.values.assign(proto.value().begin(), proto.value().end());
  return batch;
}

v1::ReadingsHeader ToProto(const ReadingsSpec& spec) {
  v1::ReadingsHeader proto;
  proto.set_dataset(spec.dataset);
  proto.set_durability(spec.acknowledge_received ? v1::ReadingsHeader::RECEIVED
                                                 : v1::ReadingsHeader::COMMITTED);
  proto.mutable_fields()->Assign(spec.fields.begin(), spec.fields.end());
  if (spec.grid) {
    const auto put = [](const Vec3& from, v1::Vec3* to) {
      to->set_x(from.x);
      to->set_y(from.y);
      to->set_z(from.z);
    };
    const Int3& dims = spec.grid->hierarchy.dims();
    Vec3 upper;
    for (int axis = 0; axis < 3; ++axis) {
      upper[axis] =
          spec.grid->lower[axis] + spec.grid->voxel[axis] * static_cast<double>(dims[axis]);
    }
    put(spec.grid->lower, proto.mutable_lower());
    put(upper, proto.mutable_upper());
    put(spec.grid->voxel, proto.mutable_voxel());
  }
  proto.set_step_seconds(*spec.steps.window_s);
  proto.set_start_seconds(spec.steps.start_s);
  proto.set_watermark_seconds(spec.steps.watermark_s);
  proto.set_most_ahead(static_cast<uint64_t>(spec.steps.most_ahead));
  proto.set_on_missing(spec.steps.on_empty == sensors::OnEmpty::kHold ? v1::ReadingsHeader::HOLD
                                                                      : v1::ReadingsHeader::SKIP);
  proto.set_duplicates(spec.duplicates == sensors::Duplicates::kMean ? v1::ReadingsHeader::MEAN
                                                                     : v1::ReadingsHeader::LAST);
  proto.set_least_value(spec.least_value);
  proto.set_greatest_value(spec.greatest_value);
  proto.set_reach_voxels(static_cast<uint64_t>(spec.fill.reach_voxels));
  proto.set_background(spec.fill.background);
  proto.set_world_unit(spec.world_unit);
  proto.set_value_unit(spec.value_unit);
  proto.set_clock(spec.clock);
  proto.set_chunk_edge(static_cast<uint32_t>(spec.chunk_edge));
  return proto;
}

v1::ReadingBatch ToProto(const ReadingBatch& batch) {
  v1::ReadingBatch proto;
  proto.set_sequence(batch.sequence);
  for (const sensors::Reading& reading : batch.readings) {
    // A time that is not finite stays one that is left out.
    constexpr double kNoTime = 9.223e9;
    const double time_s = std::abs(reading.time_s) <= kNoTime ? reading.time_s : kNoTime;
    proto.add_time_ns(std::llround(time_s * 1e9));
    proto.add_x(reading.x);
    proto.add_y(reading.y);
    proto.add_z(reading.z);
  }
  proto.mutable_value()->Assign(batch.values.begin(), batch.values.end());
  if (batch.complete_before_ns) {
    proto.set_complete_before_ns(*batch.complete_before_ns);
  }
  proto.set_last(batch.last);
  return proto;
}

int64_t ReadingsOfOneMessage(int fields) {
  return (kMaxReadingsMessageBytes - kOtherBytes) / (kReadingBytes + 4 * fields);
}

v1::ReadingCounts ToProto(const sensors::ReadingCounts& counts) {
  v1::ReadingCounts proto;
  proto.set_read(static_cast<uint64_t>(counts.read));
  proto.set_used(static_cast<uint64_t>(counts.used));
  proto.set_duplicates(static_cast<uint64_t>(counts.duplicates));
  proto.set_not_finite(static_cast<uint64_t>(counts.not_finite));
  proto.set_out_of_range(static_cast<uint64_t>(counts.out_of_range));
  proto.set_outside(static_cast<uint64_t>(counts.outside));
  proto.set_late(static_cast<uint64_t>(counts.late));
  proto.set_ahead(static_cast<uint64_t>(counts.ahead));
  proto.set_pending(static_cast<uint64_t>(counts.pending));
  proto.set_empty_windows(static_cast<uint64_t>(counts.empty_windows));
  return proto;
}

sensors::ReadingCounts FromProto(const v1::ReadingCounts& proto) {
  sensors::ReadingCounts counts;
  counts.read = static_cast<int64_t>(proto.read());
  counts.used = static_cast<int64_t>(proto.used());
  counts.duplicates = static_cast<int64_t>(proto.duplicates());
  counts.not_finite = static_cast<int64_t>(proto.not_finite());
  counts.out_of_range = static_cast<int64_t>(proto.out_of_range());
  counts.outside = static_cast<int64_t>(proto.outside());
  counts.late = static_cast<int64_t>(proto.late());
  counts.ahead = static_cast<int64_t>(proto.ahead());
  counts.pending = static_cast<int64_t>(proto.pending());
  counts.empty_windows = static_cast<int64_t>(proto.empty_windows());
  return counts;
}

}  // namespace fovea::wire
