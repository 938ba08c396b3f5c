#include "ingest/worker/sandbox.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <thread>

#include <linux/capability.h>
#include <linux/landlock.h>

#include "ingest/worker/system_call_filter.h"

namespace fovea::ingest {
namespace {

// What Landlock learned after the headers of Debian 12 were made, by the ABI that brought it
// (Documentation/userspace-api/landlock.rst). The kernel takes a structure that is longer than it
// knows as long as the rest is zero.
constexpr uint64_t kAllFileAccessOfAbi1 = (uint64_t{1} << 13) - 1;
constexpr uint64_t kReferSinceAbi2 = uint64_t{1} << 13;
constexpr uint64_t kTruncateSinceAbi3 = uint64_t{1} << 14;
constexpr uint64_t kDeviceControlSinceAbi5 = uint64_t{1} << 15;
constexpr uint64_t kTcpBindAndConnectSinceAbi4 = 3;
constexpr uint64_t kAbstractSocketsAndSignalsSinceAbi6 = 3;

struct RulesetAttributes {
  uint64_t handled_access_fs = 0;
  uint64_t handled_access_net = 0;  // since ABI 4
  uint64_t scoped = 0;              // since ABI 6
};

/// A descriptor that is closed at the end.
class Descriptor {
 public:
  explicit Descriptor(long number) : number_(static_cast<int>(number)) {}
  ~Descriptor() {
    if (number_ >= 0) {
      ::close(number_);
    }
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int number() const { return number_; }

 private:
  int number_;
};

Status Failed(const char* what) {
  return Internal("cannot confine the worker: {}: {}", what, std::strerror(errno));
}

/// 0: none, with the reason in errno.
int LandlockAbi() {
  const long abi =
      ::syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  return abi > 0 ? static_cast<int>(abi) : 0;
}

/// Everything that this ABI can refuse.
RulesetAttributes EverythingOf(int abi) {
  RulesetAttributes attributes;
  attributes.handled_access_fs = kAllFileAccessOfAbi1 | (abi >= 2 ? kReferSinceAbi2 : 0) |
                                 (abi >= 3 ? kTruncateSinceAbi3 : 0) |
                                 (abi >= 5 ? kDeviceControlSinceAbi5 : 0);
  attributes.handled_access_net = abi >= 4 ? kTcpBindAndConnectSinceAbi4 : 0;
  attributes.scoped = abi >= 6 ? kAbstractSocketsAndSignalsSinceAbi6 : 0;
  return attributes;
}

Status AllowReading(const std::string& path, int ruleset) {
  const Descriptor file(::open(path.c_str(), O_PATH | O_CLOEXEC));
  if (file.number() < 0) {
    return absl::OkStatus();  // whoever reads it will say so
  }
  landlock_path_beneath_attr rule{};
  rule.allowed_access = LANDLOCK_ACCESS_FS_READ_FILE;
  rule.parent_fd = file.number();
  if (::syscall(SYS_landlock_add_rule, ruleset, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) != 0) {
    return Internal("cannot confine the worker to '{}': {}", path, std::strerror(errno));
  }
  return absl::OkStatus();
}

Status RestrictFiles(std::span<const std::string> files, int abi) {
  const RulesetAttributes attributes = EverythingOf(abi);
  const Descriptor ruleset(
      ::syscall(SYS_landlock_create_ruleset, &attributes, sizeof(attributes), 0));
  if (ruleset.number() < 0) {
    return Failed("landlock_create_ruleset");
  }
#ifdef FOVEA_SANITIZED  // their reports read it
  FOVEA_RETURN_IF_ERROR(AllowReading("/proc/self", ruleset.number()));
#endif
  for (const std::string& path : files) {
    FOVEA_RETURN_IF_ERROR(AllowReading(path, ruleset.number()));
  }
  if (::syscall(SYS_landlock_restrict_self, ruleset.number(), 0) != 0) {
    return Failed("landlock_restrict_self");
  }
  return absl::OkStatus();
}

/// Root keeps nothing of root but the right to read any file, which Landlock then narrows.
Status DropCapabilities() {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct sets[2] = {};
  if (::syscall(SYS_capget, &header, sets) != 0) {
    return Failed("capget");
  }
  const uint32_t kept = sets[0].permitted & (uint32_t{1} << CAP_DAC_READ_SEARCH);
  sets[0] = {kept, kept, 0};
  sets[1] = {};
  return ::syscall(SYS_capset, &header, sets) == 0 ? absl::OkStatus() : Failed("capset");
}

[[maybe_unused]] int CountThreads() {  // not in sanitizer builds
  std::error_code error;
  int threads = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/task", error)) {
    static_cast<void>(entry);
    ++threads;
  }
  return threads;
}

/// A thread that was joined takes a moment to leave the kernel's list.
Status CheckSingleThread() {
#ifndef FOVEA_SANITIZED  // they have threads of their own
  constexpr auto kPatience = std::chrono::seconds(2);
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  int threads = CountThreads();
  while (threads > 1 && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::microseconds(50));
    threads = CountThreads();
  }
  if (threads > 1) {
    return FailedPrecondition("cannot confine the worker: it has {} threads already", threads);
  }
#endif
  return absl::OkStatus();
}

}  // namespace

Confinement KernelConfinement(std::string* landlock_problem) {
  const int abi = LandlockAbi();
  if (landlock_problem != nullptr && abi == 0) {
    *landlock_problem = errno == EOPNOTSUPP ? "it is built in, but switched off at boot (lsm=)"
                                            : "this kernel is built without it";
  }
  return {abi, HasSystemCallFilter()};
}

StatusOr<Confinement> Confine(std::span<const std::string> files) {
  FOVEA_RETURN_IF_ERROR(CheckSingleThread());
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
    return Failed("PR_SET_NO_NEW_PRIVS");
  }
  Confinement confinement = {LandlockAbi(), HasSystemCallFilter()};
  if (confinement.landlock_abi > 0) {
    FOVEA_RETURN_IF_ERROR(RestrictFiles(files, confinement.landlock_abi));
  }
  FOVEA_RETURN_IF_ERROR(DropCapabilities());
#ifdef FOVEA_SANITIZED
  confinement.system_calls_filtered = false;
#endif
  if (confinement.system_calls_filtered) {
    FOVEA_RETURN_IF_ERROR(FilterSystemCalls());
  }
  return confinement;
}

}  // namespace fovea::ingest
