#include "engine/store/repair_series.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "engine/fovea/reconstruct.h"
#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"
#include "engine/store/step_source.h"

namespace fovea::store {
namespace {

constexpr int64_t kDefaultSpacingNs = 1'000'000'000;
/// Voxels of which statistics are made at once.
constexpr int64_t kSlabVoxels = 1 << 22;

std::string FileOf(const ArraySpec& array, int64_t chunk) {
  const std::vector<int64_t> one = {chunk};
  const std::vector<int64_t> with_row = {chunk, 0};
  return fmt::format("{}/{}", array.path, ChunkName(array.chunk.size() > 1 ? with_row : one));
}

/// Damage, and not something that may be otherwise the next time.
bool IsDamage(const Status& status) {
  return absl::IsDataLoss(status) || absl::IsNotFound(status);
}

template <typename T>
Status WriteChunk(const ArraySpec& array, int64_t chunk, SeriesChunk<T>* rows,
                  RepairTarget* target) {
  Encoder encoder;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded, encoder.Encode(rows->Bytes()));
  return target->batch()->Write(target->PathOf(FileOf(array, chunk)), encoded);
}

struct Range {
  double least = INFINITY, most = -INFINITY;
};

/// Calls `each` with all voxels of a step, in slabs.
template <typename Each>
Status ForEachVoxel(CoefficientSource& source, const Each& each) {
  const Int3 dims = source.hierarchy().dims();
  const int64_t layers = std::clamp<int64_t>(kSlabVoxels / (dims.x * dims.y), 1, dims.z);
  for (int64_t z = 0; z < dims.z; z += layers) {
    const Box3 slab{{0, 0, z}, {dims.x, dims.y, std::min(dims.z, z + layers)}};
    FOVEA_ASSIGN_OR_RETURN(const Grid voxels, ExtractVoxels(source, slab));
    for (const float value : voxels.values) {
      each(static_cast<double>(value));
    }
  }
  return absl::OkStatus();
}

}  // namespace

Status SeriesRepair::LookAt(const ArraySpec& array, const std::string& field, int64_t steps,
                            RepairReport* report) {
  const int64_t per_file = array.FileSteps();
  int64_t values = 1;
  for (const int64_t size : array.chunk) {
    values *= size;
  }
  std::vector<int64_t> raw(static_cast<size_t>(values));  // 8 bytes each, whatever they are
  for (int64_t chunk = 0; chunk * per_file < steps; ++chunk) {
    const std::string file = FileOf(array, chunk);
    const StatusOr<int64_t> read =
        ReadChunkFile(files_, path_ + "/" + file, std::as_writable_bytes(std::span(raw)));
    if (read.ok()) {
      FOVEA_RETURN_IF_ERROR(target_->Keep(file));
      continue;
    }
    if (!IsDamage(read.status())) {
      return read.status();
    }
    damaged_.push_back({array, field, chunk});
    const std::string what = fmt::format("{} of steps {} to {}", array.path, chunk * per_file,
                                         std::min(steps, (chunk + 1) * per_file) - 1);
    if (array.path == kTimePath) {
      report->lost.push_back(what + ": the times between those before and after stand there");
    } else if (array.path == kFrameNumberPath) {
      report->lost.push_back(what + ": these steps have no numbers now");
    } else {
      report->rebuilt.push_back(what + ": computed from the coefficients that are there");
    }
  }
  return absl::OkStatus();
}

Status SeriesRepair::Look(const DatasetInfo& info, RepairReport* report) {
  for (const ArraySpec& array : AllArrays(info)) {
    if (array.path == kTimePath || array.path == kFrameNumberPath) {
      FOVEA_RETURN_IF_ERROR(LookAt(array, "", info.committed_steps, report));
    }
    for (const FieldInfo& field : info.fields) {
      if (array.path == StatsPath(field.name) || array.path == HistogramPath(field.name)) {
        FOVEA_RETURN_IF_ERROR(LookAt(array, field.name, info.committed_steps, report));
      }
    }
  }
  return absl::OkStatus();
}

StatusOr<FieldInfo> SeriesRepair::Range(const FieldInfo& field, int64_t steps) const {
  FieldInfo with = field;
  store::Range range;
  for (int64_t first = 0; first < steps; first += kSeriesSteps) {
    auto rows = ReadSeries<double>(files_, path_, StatsPath(field.name), first, kSeriesSteps, 2);
    for (int64_t step = first; rows.ok() && step < std::min(steps, first + kSeriesSteps); ++step) {
      range.least = std::min(range.least, rows->Row(step)[0]);
      range.most = std::max(range.most, rows->Row(step)[1]);
    }
  }
  with.minimum = range.least <= range.most ? range.least : 0;
  with.maximum = range.least <= range.most ? range.most : 0;
  return with;
}

StatusOr<std::vector<int64_t>> SeriesRepair::Times(int64_t steps) const {
  std::vector<int64_t> times(static_cast<size_t>(steps));
  std::vector<bool> known(times.size(), false);
  for (int64_t first = 0; first < steps; first += kSeriesSteps) {
    auto rows = ReadSeries<int64_t>(files_, path_, std::string(kTimePath), first, kSeriesSteps, 0);
    for (int64_t step = first; rows.ok() && step < std::min(steps, first + kSeriesSteps); ++step) {
      times[static_cast<size_t>(step)] = rows->Row(step)[0];
      known[static_cast<size_t>(step)] = true;
    }
  }
  for (size_t a = 0; a < times.size(); ++a) {
    if (known[a]) {
      continue;
    }
    const auto next = std::find(known.begin() + static_cast<int64_t>(a), known.end(), true);
    const auto b = static_cast<size_t>(next - known.begin());
    // As far apart as the steps beside them are, or as they must be to fit in between.
    int64_t spacing = kDefaultSpacingNs;
    if (a > 0 && b < times.size()) {
      spacing = (times[b] - times[a - 1]) / static_cast<int64_t>(b - a + 1);
    } else if (a > 1) {
      spacing = times[a - 1] - times[a - 2];
    } else if (b + 1 < times.size() && known[b + 1]) {
      spacing = times[b + 1] - times[b];
    }
    if (a == 0 && b < times.size()) {
      times[0] = times[b] - spacing * static_cast<int64_t>(b);
    } else if (a > 0) {
      times[a] = times[a - 1] + spacing;
    }
    known[a] = true;
  }
  return times;
}

Status SeriesRepair::WriteTimes(const ArraySpec& array, int64_t chunk, int64_t steps) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<int64_t> times, Times(steps));
  SeriesChunk<int64_t> rows(kSeriesSteps, 1, 0);
  const int64_t first = chunk * kSeriesSteps;
  for (int64_t step = first; step < std::min(steps, first + kSeriesSteps); ++step) {
    rows.Row(step)[0] = times[static_cast<size_t>(step)];
  }
  return WriteChunk(array, chunk, &rows, target_);
}

StatusOr<FieldStats> SeriesRepair::Compute(const DatasetInfo& info, const FieldInfo& field,
                                           int64_t step) const {
  FieldStats stats;
  if (std::binary_search(field.lost_steps.begin(), field.lost_steps.end(), step)) {
    stats.histogram[0] = static_cast<uint64_t>(info.hierarchy.dims().Product());
    return stats;
  }
  const auto source =
      MakeStepSource(files_, target_->folder(), info, step, field.name, OnDamage::kFail);
  // Of the rows that were written, if they are sound: the values are what they were.
  auto known = ReadSeries<double>(files_, path_, StatsPath(field.name), step, kSeriesSteps, 2);
  store::Range range;
  if (known.ok()) {
    range = {known->Row(step)[0], known->Row(step)[1]};
  } else {
    FOVEA_RETURN_IF_ERROR(ForEachVoxel(*source, [&](double value) {
      range.least = std::min(range.least, value);
      range.most = std::max(range.most, value);
    }));
  }
  stats.minimum = range.least;
  stats.maximum = range.most;
  const double scale = range.most > range.least ? 256.0 / (range.most - range.least) : 0.0;
  FOVEA_RETURN_IF_ERROR(ForEachVoxel(*source, [&](double value) {
    const double bin = std::clamp((value - range.least) * scale, 0.0, 255.0);
    ++stats.histogram[static_cast<size_t>(bin)];
  }));
  return stats;
}

Status SeriesRepair::WriteStatistics(const DatasetInfo& info, const FieldInfo& field,
                                     const Damaged& damaged) {
  const int64_t per_file = damaged.array.FileSteps();
  const int64_t first = damaged.chunk * per_file;
  SeriesChunk<double> ranges(kSeriesSteps, 2, 0.0);
  SeriesChunk<uint64_t> histograms(kHistogramSteps, 256, 0);
  const bool is_range = damaged.array.path == StatsPath(field.name);
  for (int64_t step = first; step < std::min(info.committed_steps, first + per_file); ++step) {
    FOVEA_ASSIGN_OR_RETURN(const FieldStats stats, Compute(info, field, step));
    if (is_range) {
      ranges.Row(step)[0] = stats.minimum;
      ranges.Row(step)[1] = stats.maximum;
    } else {
      std::copy(stats.histogram.begin(), stats.histogram.end(), histograms.Row(step).begin());
    }
  }
  return is_range ? WriteChunk(damaged.array, damaged.chunk, &ranges, target_)
                  : WriteChunk(damaged.array, damaged.chunk, &histograms, target_);
}

Status SeriesRepair::Write(const DatasetInfo& info) {
  for (const Damaged& damaged : damaged_) {
    if (damaged.array.path == kTimePath) {
      FOVEA_RETURN_IF_ERROR(WriteTimes(damaged.array, damaged.chunk, info.committed_steps));
    } else if (damaged.array.path == kFrameNumberPath) {
      SeriesChunk<int64_t> rows(kSeriesSteps, 1, kNoFrameNumber);
      FOVEA_RETURN_IF_ERROR(WriteChunk(damaged.array, damaged.chunk, &rows, target_));
    } else {
      const auto field = std::find_if(info.fields.begin(), info.fields.end(),
                                      [&](const FieldInfo& f) { return f.name == damaged.field; });
      FOVEA_RETURN_IF_ERROR(WriteStatistics(info, *field, damaged));
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
