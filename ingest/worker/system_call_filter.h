#ifndef INGEST_WORKER_SYSTEM_CALL_FILTER_H_
#define INGEST_WORKER_SYSTEM_CALL_FILTER_H_

#include "engine/base/status.h"

namespace fovea::ingest {

/// Whether the kernel filters system calls (seccomp), and we know the numbers of this processor.
[[nodiscard]] bool HasSystemCallFilter();

/// Allows this process, from now on, the system calls that reading files, memory, threads and the
/// open descriptors need (system_call_filter.cc lists them); any other fails with EPERM, clone3
/// with ENOSYS so that the C library falls back to clone. Needs PR_SET_NO_NEW_PRIVS.
[[nodiscard]] Status FilterSystemCalls();

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_SYSTEM_CALL_FILTER_H_
