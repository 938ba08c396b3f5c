#include "ingest/sensors/sensor_store.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset.h"
#include "ingest/sensors/voxel_box.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kDetailBands = 7;

double MachineMemory() {
  return static_cast<double>(::sysconf(_SC_PHYS_PAGES)) *
         static_cast<double>(::sysconf(_SC_PAGESIZE));
}

/// A field that is 0 everywhere: the coverage of a step that repeats the one before.
sensors::FilledField ZeroField(const Hierarchy& hierarchy, int64_t brick_edge) {
  sensors::FilledField field;
  field.coefficients.hierarchy = hierarchy;
  field.coefficients.coarse = Grid(Box3::OfSize(hierarchy.DimsAt(0)));
  for (int level = 0; level < hierarchy.finest(); ++level) {
    field.coefficients.detail.emplace_back(hierarchy.DimsAt(level), brick_edge,
                                           static_cast<int>(kDetailBands), 0.0F);
  }
  field.stats.histogram[0] = static_cast<uint64_t>(hierarchy.dims().Product());
  return field;
}

}  // namespace

StatusOr<std::unique_ptr<SensorStore>> SensorStore::Create(const std::string& path,
                                                           const SensorStoreSpec& spec) {
  store::DatasetInfo info;
  info.hierarchy = spec.grid.hierarchy;
  info.index_to_world = spec.grid.IndexToWorld();
  info.world_unit = spec.world_unit;
  info.clock = spec.clock;
  info.chunk_edge = spec.chunk_edge;
  info.default_field = spec.fields.front();
  for (const std::string& name : spec.fields) {
    store::FieldInfo& field = info.fields.emplace_back();
    field.name = name;
    field.value_unit = spec.value_unit;
  }
  info.fields.emplace_back().name = kCoverageField;
  const Stopwatch watch;
  auto made = std::unique_ptr<SensorStore>(new SensorStore);
  FOVEA_ASSIGN_OR_RETURN(made->writer_, store::DatasetWriter::Create(path, info));
  made->grid_ = spec.grid;
  made->fields_ = spec.fields;
  made->write_ms_ = watch.ElapsedMs();
  return made;
}

StatusOr<std::unique_ptr<SensorStore>> SensorStore::Append(const std::string& path) {
  auto opened = std::unique_ptr<SensorStore>(new SensorStore);
  FOVEA_ASSIGN_OR_RETURN(opened->writer_, store::DatasetWriter::Append(path));
  const store::DatasetInfo& info = opened->writer_->info();
  auto grid = VoxelsOfStore(info.hierarchy, info.index_to_world);
  FOVEA_RETURN_IF_ERROR(Annotate(grid.status(), fmt::format("'{}'", path)));
  opened->grid_ = *std::move(grid);
  FOVEA_RETURN_IF_ERROR(opened->ReadFields(path));
  const int64_t steps = info.committed_steps;
  if (steps > 0) {
    FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(path));
    FOVEA_ASSIGN_OR_RETURN(opened->last_time_ns_, dataset->TimeNs(steps - 1));
    FOVEA_ASSIGN_OR_RETURN(opened->last_frame_, dataset->FrameNumber(steps - 1));
  }
  return opened;
}

Status SensorStore::ReadFields(const std::string& path) {
  const store::DatasetInfo& info = writer_->info();
  bool has_coverage = false;
  for (const store::FieldInfo& field : info.fields) {
    has_coverage = has_coverage || field.name == kCoverageField;
    if (field.name != kCoverageField) {
      fields_.push_back(field.name);
    }
    if (field.type != "float32" || info.wavelet != "haar") {
      return FailedPrecondition("'{}' holds {} {} coefficients: readings become haar float32", path,
                                info.wavelet, field.type);
    }
  }
  if (!has_coverage || fields_.empty()) {
    return FailedPrecondition(
        "'{}' has {} fields and {} coverage: to add readings to it, it must have been made of "
        "readings (fovea sensors)",
        path, fields_.size(), has_coverage ? "a" : "no");
  }
  return absl::OkStatus();
}

Status SensorStore::OrderFields(const std::vector<std::string>& fields) {
  if (!std::is_permutation(fields.begin(), fields.end(), fields_.begin(), fields_.end())) {
    std::string there;
    for (const std::string& field : fields_) {
      there += (there.empty() ? "" : ", ") + field;
    }
    return FailedPrecondition("the dataset has other fields: {}", there);
  }
  fields_ = fields;
  return absl::OkStatus();
}

std::optional<int64_t> SensorStore::NextWindow(double start_s, double window_s) const {
  if (!last_time_ns_) {
    return std::nullopt;
  }
  // Half a window more, against rounding.
  const double last = static_cast<double>(*last_time_ns_) / 1e9;
  return static_cast<int64_t>(std::floor((last - start_s) / window_s + 0.5)) + 1;
}

Status SensorStore::CheckBricks(const sensors::ClosedStep& step) const {
  const int64_t edge = writer_->info().chunk_edge;
  const double need =
      static_cast<double>(sensors::CountBricks(grid_.hierarchy, edge, step.voxels.keys) *
                          kDetailBands * edge * edge * edge * static_cast<int64_t>(sizeof(float)));
  if (need > MachineMemory() / 4) {
    return ResourceExhausted(
        "{} voxels with readings lie so far apart that a step needs {:.1f} GB, more than a quarter "
        "of this machine's memory: make voxels larger (--voxel), or chunks smaller (--chunk 8)",
        step.voxels.keys.size(), need / 1e9);
  }
  return absl::OkStatus();
}

Status SensorStore::WriteOne(const std::string& name, const sensors::FilledField& field) {
  const Stopwatch watch;
  const Status status = writer_->WriteField(name, field.coefficients, field.stats);
  write_ms_ += watch.ElapsedMs();
  return status;
}

Status SensorStore::Write(const sensors::ClosedStep& step, const sensors::FillRule& fill) {
  FOVEA_RETURN_IF_ERROR(CheckBricks(step));
  const int64_t edge = writer_->info().chunk_edge;
  Stopwatch watch;
  for (size_t channel = 0; channel < fields_.size(); ++channel) {
    watch.RestartMs();
    const sensors::FilledField field = sensors::FillField(grid_.hierarchy, edge, step.voxels.keys,
                                                          step.voxels.values[channel], fill);
    fill_ms_ += watch.ElapsedMs();
    FOVEA_RETURN_IF_ERROR(WriteOne(fields_[channel], field));
  }
  watch.RestartMs();
  const sensors::FilledField coverage =
      step.held ? ZeroField(grid_.hierarchy, edge)
                : sensors::FillCoverage(grid_.hierarchy, edge, step.voxels.keys, fill);
  fill_ms_ += watch.ElapsedMs();
  FOVEA_RETURN_IF_ERROR(WriteOne(kCoverageField, coverage));
  const int64_t time_ns = std::max(step.time_ns, last_time_ns_.value_or(step.time_ns));
  if (time_ns != step.time_ns && moved_.steps++ == 0) {
    moved_.from_ns = step.time_ns;
    moved_.to_ns = time_ns;
  }
  watch.RestartMs();
  const Status ended = writer_->EndStep(time_ns, step.frame_number);
  write_ms_ += watch.ElapsedMs();
  FOVEA_RETURN_IF_ERROR(ended);
  last_time_ns_ = time_ns;
  last_frame_ = step.frame_number;
  return absl::OkStatus();
}

Status SensorStore::Publish() {
  const Stopwatch watch;
  const Status status = writer_->Publish();
  write_ms_ += watch.ElapsedMs();
  return status;
}

int64_t MostPendingReadings(int channels) {
  return std::min<int64_t>(int64_t{1} << 31,
                           static_cast<int64_t>(MachineMemory() / 4) / (48 + 8 * channels));
}

}  // namespace fovea::ingest
