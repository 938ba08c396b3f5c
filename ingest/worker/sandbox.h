#ifndef INGEST_WORKER_SANDBOX_H_
#define INGEST_WORKER_SANDBOX_H_

#include <span>
#include <string>

#include "engine/base/status.h"

/// What a process that parses foreign files gives up before it reads the first byte of them
/// (docs/formats/worker.md, docs/decisions/0012). What the kernel offers is asked at run time.
namespace fovea::ingest {

/// What the kernel offers, or what is in force.
struct Confinement {
  int landlock_abi = 0;  // 0: no Landlock; files (1), TCP (4), signals and sockets (6)
  bool system_calls_filtered = false;  // seccomp
};

/// What this kernel offers to any process. `landlock_problem`, if given, gets the reason for none.
[[nodiscard]] Confinement KernelConfinement(std::string* landlock_problem = nullptr);

/// From now on this process, and every thread it makes, reads the given files and nothing else: it
/// opens no other path, none for writing, no socket; it starts and traces no program, loads no
/// code, signals no other process, and has no capability but that of reading. Threads, memory and
/// what is open stay. Cannot be undone. A file that is not there is left out.
///
/// Returns what is in force: a kernel without Landlock or seccomp leaves that part out. To be
/// called while the process has one thread (FAILED_PRECONDITION), because the kernel confines the
/// calling thread and those that it makes. Programs built with sanitizers are not filtered: their
/// reports need the forbidden calls.
[[nodiscard]] StatusOr<Confinement> Confine(std::span<const std::string> files);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_SANDBOX_H_
