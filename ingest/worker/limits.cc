#include "ingest/worker/limits.h"

#include <sys/prctl.h>
#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <new>
#include <utility>

namespace fovea::ingest {
namespace {

constexpr rlim_t kMaxOpenFiles = 64;

Status SetLimit(__rlimit_resource resource, const char* name, rlim_t soft, rlim_t hard) {
  const rlimit limit{soft, hard};
  if (::setrlimit(resource, &limit) != 0) {
    return Internal("cannot set the limit {}: {}", name, std::strerror(errno));
  }
  return absl::OkStatus();
}

/// OpenVDB's trees allocate while they are destroyed. What is kept back here is given up at the
/// first allocation that fails, so that the error can still be carried out.
void* reserve = nullptr;
constexpr size_t kReserveBytes = 16 << 20;

[[noreturn]] void GiveUpReserve() {
  std::free(std::exchange(reserve, nullptr));
  throw std::bad_alloc();
}

}  // namespace

Status LimitProcess(int64_t memory_bytes, bool dies_with_thread) {
  const int signal = dies_with_thread ? SIGKILL : 0;
  if (::prctl(PR_SET_PDEATHSIG, signal, 0, 0, 0) != 0 ||
      ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
    return Internal("prctl: {}", std::strerror(errno));
  }
  FOVEA_RETURN_IF_ERROR(SetLimit(RLIMIT_CORE, "RLIMIT_CORE", 0, 0));
  FOVEA_RETURN_IF_ERROR(SetLimit(RLIMIT_NOFILE, "RLIMIT_NOFILE", kMaxOpenFiles, kMaxOpenFiles));
  if (memory_bytes > 0) {
    const auto bytes = static_cast<rlim_t>(memory_bytes);
    FOVEA_RETURN_IF_ERROR(SetLimit(RLIMIT_AS, "RLIMIT_AS", bytes, bytes));
    reserve = std::malloc(kReserveBytes);
    std::set_new_handler(GiveUpReserve);
  }
  return absl::OkStatus();
}

Status OutOfMemory() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) {
    return ResourceExhausted("reading it needs more memory than there is");
  }
  return ResourceExhausted(
      "reading it needs more memory than its worker may use ({} MB); allow more with "
      "--worker-memory",
      limit.rlim_cur >> 20);
}

Status LimitProcessorTime(int64_t seconds) {
  rusage used{};
  rlimit limit{};
  if (::getrusage(RUSAGE_SELF, &used) != 0 || ::getrlimit(RLIMIT_CPU, &limit) != 0) {
    return Internal("getrusage: {}", std::strerror(errno));
  }
  const int64_t spent = used.ru_utime.tv_sec + used.ru_stime.tv_sec + 1;
  const auto soft = static_cast<rlim_t>(spent + seconds);
  return SetLimit(RLIMIT_CPU, "RLIMIT_CPU", std::min(soft, limit.rlim_max), limit.rlim_max);
}

}  // namespace fovea::ingest
