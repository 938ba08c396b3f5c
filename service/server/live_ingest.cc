#include "service/server/live_ingest.h"

#include <cmath>
#include <utility>

#include <spdlog/spdlog.h>

#include "engine/store/removal.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

constexpr char kDefaultField[] = "value";

/// The same box, but for rounding.
bool IsSame(const sensors::VoxelGrid& a, const sensors::VoxelGrid& b) {
  constexpr double kOfAVoxel = 1e-6;
  for (int axis = 0; axis < 3; ++axis) {
    const double slack = kOfAVoxel * a.voxel[axis];
    const auto count = static_cast<double>(a.hierarchy.dims()[axis]);
    if (!(std::abs(a.lower[axis] - b.lower[axis]) <= slack) ||
        !(std::abs(a.voxel[axis] - b.voxel[axis]) * count <= slack)) {
      return false;
    }
  }
  return a.hierarchy.dims() == b.hierarchy.dims();
}

}  // namespace

StatusOr<std::unique_ptr<LiveIngest>> LiveIngest::Open(Catalogue& catalogue,
                                                       const wire::ReadingsSpec& spec) {
  auto opened = std::unique_ptr<LiveIngest>(new LiveIngest);
  FOVEA_RETURN_IF_ERROR(opened->OpenStore(catalogue, spec));
  FOVEA_RETURN_IF_ERROR(opened->StartBinner(spec));
  return opened;
}

LiveIngest::~LiveIngest() {
  if (store_ == nullptr || made_path_.empty() || store_->committed_steps() > 0) {
    return;
  }
  if (const Status removed = store::RemoveHeldStore(made_path_); !removed.ok()) {
    spdlog::warn("a dataset without a step stays: {}", MessageOf(removed));
  }
}

Status LiveIngest::OpenStore(Catalogue& catalogue, const wire::ReadingsSpec& spec) {
  const auto found = catalogue.FindNow(spec.dataset);
  if (found.ok()) {
    return Append(**found, spec);
  }
  if (!spec.grid) {
    return absl::IsNotFound(found.status())
               ? wire::BadField("header.voxel",
                                fmt::format("is missing, and so are lower and upper: there is no "
                                            "dataset '{}', so its box must be said",
                                            spec.dataset))
               : found.status();
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string path, catalogue.PathOfNew(spec.dataset));
  ingest::SensorStoreSpec made;
  made.grid = *spec.grid;
  made.fields = spec.fields.empty() ? std::vector<std::string>{kDefaultField} : spec.fields;
  made.world_unit = spec.world_unit;
  made.value_unit = spec.value_unit;
  made.clock = spec.clock;
  made.chunk_edge = spec.chunk_edge;
  auto store = ingest::SensorStore::Create(path, made);
  if (absl::IsAlreadyExists(store.status())) {
    // Another made it just now, or it is there and cannot be opened.
    FOVEA_ASSIGN_OR_RETURN(const auto made_meanwhile, catalogue.FindNow(spec.dataset));
    return Append(*made_meanwhile, spec);
  }
  FOVEA_RETURN_IF_ERROR(store.status());
  store_ = *std::move(store);
  made_path_ = path;
  // Whoever asks for it from now on finds it.
  return catalogue.FindNow(spec.dataset).status();
}

Status LiveIngest::Append(ServedDataset& dataset, const wire::ReadingsSpec& spec) {
  FOVEA_ASSIGN_OR_RETURN(store_, ingest::SensorStore::Append(dataset.dataset().path()));
  if (spec.grid && !IsSame(*spec.grid, store_->grid())) {
    const sensors::VoxelGrid& grid = store_->grid();
    const Int3& dims = grid.hierarchy.dims();
    return FailedPrecondition(
        "dataset '{}' has another box than header.lower, upper and voxel say: {} x {} x {} voxels "
        "of {}, {}, {} from {}, {}, {} on; leave the three out to take it as it is",
        spec.dataset, dims.x, dims.y, dims.z, grid.voxel.x, grid.voxel.y, grid.voxel.z,
        grid.lower.x, grid.lower.y, grid.lower.z);
  }
  if (spec.fields.empty()) {
    return absl::OkStatus();
  }
  return Annotate(store_->OrderFields(spec.fields),
                  fmt::format("header.fields: '{}'", spec.dataset));
}

Status LiveIngest::StartBinner(const wire::ReadingsSpec& spec) {
  fill_ = spec.fill;
  sensors::BinnerOptions options;
  options.grid = store_->grid();
  options.channels = fields();
  options.least_value = spec.least_value;
  options.greatest_value = spec.greatest_value;
  options.duplicates = spec.duplicates;
  options.steps = spec.steps;
  options.steps.first_window = store_->NextWindow(spec.steps.start_s, *spec.steps.window_s);
  options.most_pending = kMostPendingReadings;
  FOVEA_ASSIGN_OR_RETURN(
      binner_, sensors::ReadingBinner::Make(options, [this](const sensors::ClosedStep& step) {
        ++unpublished_;
        return store_->Write(step, fill_);
      }));
  return absl::OkStatus();
}

Status LiveIngest::Add(const wire::ReadingBatch& batch) {
  Status status = binner_->Add(batch.readings, batch.values);
  if (status.ok() && batch.complete_before_ns) {
    status = binner_->CloseBefore(static_cast<double>(*batch.complete_before_ns) / 1e9);
  }
  if (status.ok() && batch.last) {
    status = binner_->Finish();
  }
  return status;
}

Status LiveIngest::Publish() {
  if (unpublished_ > 0) {
    FOVEA_RETURN_IF_ERROR(store_->Publish());
    unpublished_ = 0;
  }
  safe_batches_ = binner_->SettledCalls();
  return absl::OkStatus();
}

}  // namespace fovea::server
