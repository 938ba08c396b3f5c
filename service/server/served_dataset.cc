#include "service/server/served_dataset.h"

#include "service/frames/frames.h"

namespace fovea::server {

Status ServedDataset::Refresh(bool now) {
  const std::lock_guard lock(refresh_mutex_);
  if (!now && Clock::now() - refreshed_ < refresh_interval_) {
    return absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(dataset_->Refresh());
  refreshed_ = Clock::now();
  return absl::OkStatus();
}

StatusOr<frames::FrameSpec> ServedDataset::DefaultSpec() {
  const std::lock_guard lock(defaults_mutex_);
  const int64_t steps = dataset_->info().committed_steps;
  if (!defaults_ || defaults_steps_ != steps) {
    FOVEA_ASSIGN_OR_RETURN(defaults_, frames::DefaultSpec(*dataset_));
    defaults_steps_ = steps;
  }
  return *defaults_;
}

StatusOr<wire::DatasetSummary> ServedDataset::Summary(bool with_default_spec) {
  wire::DatasetSummary summary;
  summary.name = name_;
  summary.info = dataset_->info();
  const int64_t steps = summary.info.committed_steps;
  if (steps == 0) {
    return summary;
  }
  FOVEA_ASSIGN_OR_RETURN(summary.first_time_ns, dataset_->TimeNs(0));
  FOVEA_ASSIGN_OR_RETURN(summary.last_time_ns, dataset_->TimeNs(steps - 1));
  if (with_default_spec) {
    FOVEA_ASSIGN_OR_RETURN(summary.default_spec, DefaultSpec());
  }
  return summary;
}

}  // namespace fovea::server
