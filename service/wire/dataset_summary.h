#ifndef SERVICE_WIRE_DATASET_SUMMARY_H_
#define SERVICE_WIRE_DATASET_SUMMARY_H_

#include <cstdint>
#include <string>

#include "engine/store/dataset.h"
#include "service/frames/spec.h"

namespace fovea::wire {

/// The plain twin of fovea.v1.Dataset.
struct DatasetSummary {
  std::string name;  // path below the server's root, without ".zarr"
  /// Origin, retention and chunk_edge are not sent; lost steps are empty in lists.
  store::DatasetInfo info;
  int64_t first_time_ns = 0, last_time_ns = 0;  // 0 without a step
  frames::FrameSpec default_spec;               // empty without a step, and in lists
};

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_DATASET_SUMMARY_H_
