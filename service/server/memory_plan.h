#ifndef SERVICE_SERVER_MEMORY_PLAN_H_
#define SERVICE_SERVER_MEMORY_PLAN_H_

#include <cstdint>
#include <string>

#include "engine/base/status.h"

namespace fovea::server {

/// How the memory of the whole process is shared out, in bytes. The parts add up to the limit, and
/// each refuses or waits on its own, so that no mix of requests gets over it.
struct MemoryPlan {
  int64_t program = 0;    // code, stacks, catalogue, allocator: not counted, so set aside
  int64_t transport = 0;  // gRPC's buffers
  int64_t requests = 0;   // of calls that run: their messages, and what a call itself takes
  int64_t replies = 0;    // frames and coefficients being made or sent
  int64_t rendering = 0;  // of jobs that run
  int64_t volumes = 0;    // kept for the next frame of the same step

  /// RESOURCE_EXHAUSTED, with the least, if `limit_bytes` is too little to serve with.
  [[nodiscard]] static StatusOr<MemoryPlan> Divide(int64_t limit_bytes);
};

/// Reads "16GB", "512MiB", "50%" (of `machine_bytes`), or bytes. INVALID_ARGUMENT.
[[nodiscard]] StatusOr<int64_t> ParseMemoryLimit(const std::string& text, int64_t machine_bytes);

/// What this process may have at most: the machine's memory, or its control group's if less.
[[nodiscard]] int64_t MachineBytes();

}  // namespace fovea::server

#endif  // SERVICE_SERVER_MEMORY_PLAN_H_
