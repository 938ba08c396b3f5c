#include "service/server/served_dataset.h"

#include <sys/stat.h>

#include "service/frames/frames.h"
#include "service/wire/status.h"

namespace fovea::server {

ServedDataset::Origin ServedDataset::OriginOf(const store::Dataset& dataset) {
  const std::string first_field = dataset.info().fields.front().name;
  struct stat folder {};
  struct stat field {};
  if (::stat(dataset.path().c_str(), &folder) != 0 ||
      ::stat(fmt::format("{}/{}/zarr.json", dataset.path(), first_field).c_str(), &field) != 0) {
    return {};
  }
  const int64_t written_ns = field.st_mtim.tv_sec * int64_t{1'000'000'000} + field.st_mtim.tv_nsec;
  return {folder.st_dev, folder.st_ino, field.st_ino, static_cast<uint64_t>(written_ns)};
}

Status ServedDataset::CheckPresent() const {
  if (!gone_ && OriginOf(*dataset_) == origin_) {
    return absl::OkStatus();
  }
  return wire::WithResource(
      NotFound("dataset '{}' was removed or replaced; call again for what is there now", name_),
      "fovea.v1.Dataset", name_);
}

Status ServedDataset::Refresh(bool now) {
  const std::lock_guard lock(refresh_mutex_);
  if (!now && Clock::now() - refreshed_ < refresh_interval_) {
    return absl::OkStatus();
  }
  if (const Status status = dataset_->Refresh(); !status.ok()) {
    FOVEA_RETURN_IF_ERROR(CheckPresent());
    return status;
  }
  refreshed_ = Clock::now();
  return absl::OkStatus();
}

StatusOr<frames::FrameSpec> ServedDataset::DefaultSpec() {
  const std::lock_guard lock(defaults_mutex_);
  const int64_t steps = dataset_->info().committed_steps;
  if (!defaults_ || defaults_steps_ != steps) {
    auto defaults = frames::DefaultSpec(*dataset_);
    FOVEA_RETURN_IF_ERROR(CheckPresent());
    FOVEA_ASSIGN_OR_RETURN(defaults_, std::move(defaults));
    defaults_steps_ = steps;
  }
  return *defaults_;
}

StatusOr<wire::DatasetSummary> ServedDataset::Summary(bool whole) {
  wire::DatasetSummary summary;
  summary.name = name_;
  summary.info = dataset_->info();
  const int64_t steps = summary.info.committed_steps;
  if (steps == 0) {
    return summary;
  }
  FOVEA_ASSIGN_OR_RETURN(summary.first_time_ns, dataset_->TimeNs(0));
  FOVEA_ASSIGN_OR_RETURN(summary.last_time_ns, dataset_->TimeNs(steps - 1));
  if (!whole) {
    for (store::FieldInfo& field : summary.info.fields) {
      field.lost_steps.clear();
    }
    return summary;
  }
  FOVEA_ASSIGN_OR_RETURN(summary.default_spec, DefaultSpec());
  return summary;
}

}  // namespace fovea::server
