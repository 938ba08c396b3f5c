#ifndef SERVICE_WIRE_VIEW_REQUEST_H_
#define SERVICE_WIRE_VIEW_REQUEST_H_

#include <cstdint>
#include <optional>
#include <string>

#include "engine/base/status.h"
#include "fovea/v1/render.pb.h"
#include "service/frames/spec.h"

namespace fovea::wire {

/// What an Explore or a RefineFrame is to show, checked: what can be told without a dataset.
struct ViewRequest {
  std::string dataset;
  uint64_t step = 0;
  std::optional<int64_t> time_ns;  // instead of the step
  bool latest = false;             // instead of both
  frames::FrameSpec spec;
  uint64_t view_id = 0;
  bool moving = false;
  double budget_ms = 0;  // of the first frame, and of each while the view moves
};

/// Errors: INVALID_ARGUMENT pointing at the field.
[[nodiscard]] StatusOr<ViewRequest> FromProto(const v1::RefineFrameRequest& proto);

/// The requests of one Explore, each on top of those before it. Not thread-safe.
class ExploreRequests {
 public:
  struct Change {
    std::optional<ViewRequest> view;  // absent: only an acknowledgement
    std::optional<uint32_t> window;
    std::optional<uint64_t> acknowledged;
  };
  /// Errors: INVALID_ARGUMENT pointing at the field; what was before is not to be gone on with.
  [[nodiscard]] StatusOr<Change> Add(const v1::ExploreRequest& proto);

 private:
  std::string dataset_;
  v1::ExploreRequest when_;  // its `when` alone
  v1::FrameSpec spec_;
  std::optional<double> budget_ms_;
};

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_VIEW_REQUEST_H_
