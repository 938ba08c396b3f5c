#ifndef SERVICE_FRAMES_PLAN_H_
#define SERVICE_FRAMES_PLAN_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "engine/base/status.h"
#include "engine/render/plan.h"
#include "engine/store/dataset.h"
#include "service/frames/spec.h"

/// What a frame will cost, from metadata alone: tables and shard indices are read, no coefficient.
namespace fovea::frames {

struct FramePlan {
  FrameSpec used;             // nothing left to default
  uint64_t coefficients = 0;  // m
  /// As FrameStats of the frame itself, exactly: chunks and bytes in a store without damage.
  uint64_t chunks_read = 0, chunks_total = 0, bytes_read = 0;
  render::FrameCounts counts;
  int threads = 1;
  render::FrameTime time;  // predicted, without encoding
  /// Of the frame, as far as they are known before it: RetentionWarning.
  std::vector<Warning> warnings;
};

/// What a frame may cost at most; what is absent is not limited.
struct FrameBudget {
  std::optional<double> ms;  // FrameTime::Total
  std::optional<uint64_t> memory_bytes, bytes_read, coefficients;
  [[nodiscard]] bool IsEmpty() const {
    return !ms && !memory_bytes && !bytes_read && !coefficients;
  }
};

/// `resolved` must come from ResolveSpec. `threads`: 0 for all processors. OUT_OF_RANGE for a step
/// that is not there; DATA_LOSS for damaged tables or indices if the spec is strict.
[[nodiscard]] StatusOr<FramePlan> PlanFrame(store::Dataset& dataset, int64_t step,
                                            const FrameSpec& resolved, int threads);

/// The plan with the largest whole rate, 1 to n along every axis, that keeps within the budget: it
/// does, and the next one does not. RESOURCE_EXHAUSTED if rate 1 does not.
[[nodiscard]] StatusOr<FramePlan> PlanWithin(store::Dataset& dataset, int64_t step,
                                             const FrameSpec& resolved, const FrameBudget& budget,
                                             int threads);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_PLAN_H_
