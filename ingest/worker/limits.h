#ifndef INGEST_WORKER_LIMITS_H_
#define INGEST_WORKER_LIMITS_H_

#include <cstdint>

#include "engine/base/status.h"

namespace fovea::ingest {

/// Gives up, before any foreign byte is read, what a reader of files does not need: memory beyond
/// `memory_bytes` of address space (0: no limit), core dumps, many open files, new privileges. With
/// `dies_with_thread` the process is killed when the thread that started it ends.
[[nodiscard]] Status LimitProcess(int64_t memory_bytes, bool dies_with_thread);

/// RESOURCE_EXHAUSTED that says how much may be used, and by which flag.
[[nodiscard]] Status OutOfMemory();

/// Allows `seconds` more of processor time, of all threads together, counted from now; SIGXCPU is
/// what comes after.
[[nodiscard]] Status LimitProcessorTime(int64_t seconds);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_LIMITS_H_
