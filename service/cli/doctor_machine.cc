#include <sys/resource.h>
#include <sys/sysinfo.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>
#include <string_view>

#include "engine/base/parallel.h"
#include "engine/base/status.h"
#include "engine/render/slab_kernel.h"
#include "service/cli/console.h"
#include "service/cli/doctor_checks.h"

namespace fovea::cli {
namespace {

constexpr int64_t kComfortableMemoryBytes = int64_t{2} << 30;
constexpr uint64_t kComfortableOpenFiles = 1024;

std::string ContentOf(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// The least limit of memory on the way from this process's control group to the root; -1: none.
/// /proc/self/cgroup has lines "0::/path" (version 2) or "4:memory:/path" (version 1).
int64_t ControlGroupLimitBytes() {
  std::istringstream lines(ContentOf("/proc/self/cgroup"));
  int64_t least = -1;
  for (std::string line; std::getline(lines, line);) {
    const size_t first = line.find(':');
    const size_t second = line.find(':', first + 1);
    if (second == std::string::npos) {
      continue;
    }
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const bool is_version_2 = controllers.empty();
    if (!is_version_2 && controllers != "memory") {
      continue;
    }
    const std::string root = is_version_2 ? "/sys/fs/cgroup" : "/sys/fs/cgroup/memory";
    const std::string file = is_version_2 ? "/memory.max" : "/memory.limit_in_bytes";
    for (std::string group = line.substr(second + 1);; group.resize(group.rfind('/'))) {
      const int64_t limit = ParseMemoryLimit(ContentOf(root + group + file));
      least = limit < 0 ? least : least < 0 ? limit : std::min(least, limit);
      if (group.find('/') == std::string::npos) {
        break;
      }
    }
  }
  return least;
}

Finding CheckMemory() {
  struct sysinfo about {};
  ::sysinfo(&about);
  const auto machine = static_cast<uint64_t>(about.totalram) * about.mem_unit;
  const int64_t limit = ControlGroupLimitBytes();
  const int64_t usable = UsableMemoryBytes();
  Finding finding{"memory", HumanBytes(machine), Verdict::kGood, ""};
  if (limit >= 0 && static_cast<uint64_t>(limit) < machine) {
    finding.found += fmt::format(", of which the control group allows {}",
                                 HumanBytes(static_cast<uint64_t>(limit)));
  }
  if (usable < kComfortableMemoryBytes) {
    finding.verdict = Verdict::kLacking;
    finding.advice =
        "volumes of 512 x 512 x 512 voxels want 2 GiB; raise the limit, or ingest "
        "with --worker-memory and one --grid at a time";
  }
  return finding;
}

std::string ShowLimit(rlim_t limit) {
  return limit == RLIM_INFINITY ? "no limit" : std::to_string(limit);
}

Finding CheckOpenFiles() {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  Finding finding{
      "open files",
      fmt::format("{} (at most {})", ShowLimit(limit.rlim_cur), ShowLimit(limit.rlim_max)),
      Verdict::kGood, ""};
  if (limit.rlim_cur < kComfortableOpenFiles) {
    finding.verdict = Verdict::kLacking;
    finding.advice =
        "a server with many clients wants 1024 or more: ulimit -n 4096, or "
        "LimitNOFILE= in its unit";
  }
  return finding;
}

Finding CheckSizes() {
  rlimit memory{};
  rlimit file{};
  ::getrlimit(RLIMIT_AS, &memory);
  ::getrlimit(RLIMIT_FSIZE, &file);
  Finding finding{"limits of size",
                  fmt::format("address space: {}, files: {}", ShowLimit(memory.rlim_cur),
                              ShowLimit(file.rlim_cur)),
                  Verdict::kGood, ""};
  if (memory.rlim_cur != RLIM_INFINITY || file.rlim_cur != RLIM_INFINITY) {
    finding.verdict = Verdict::kLacking;
    finding.advice = "large volumes may fail for it: ulimit -v unlimited -f unlimited";
  }
  return finding;
}

}  // namespace

int64_t ParseMemoryLimit(const std::string& text) {
  // Version 1 says "no limit" by a number near 2^63.
  constexpr int64_t kNoLimit = int64_t{1} << 60;
  int64_t bytes = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), bytes);
  const bool is_number = error == std::errc() && (*end == '\n' || *end == '\0');
  return is_number && bytes >= 0 && bytes < kNoLimit ? bytes : -1;
}

int64_t UsableMemoryBytes() {
  struct sysinfo about {};
  ::sysinfo(&about);
  const auto machine = static_cast<int64_t>(about.totalram) * static_cast<int64_t>(about.mem_unit);
  const int64_t limit = ControlGroupLimitBytes();
  return limit < 0 ? machine : std::min(machine, limit);
}

std::vector<Finding> CheckMachine() {
  const int usable = HardwareThreads();
  const int64_t present = ::sysconf(_SC_NPROCESSORS_ONLN);
  const std::string target = render::KernelTarget();
  Finding processors{
      "processors",
      present > usable ? fmt::format("{} (of {})", usable, present) : std::to_string(usable),
      Verdict::kGood, ""};
  Finding kernels{"instruction set", target, Verdict::kGood, ""};
  if (target != "AVX2" && !target.starts_with("AVX3")) {
    kernels.verdict = Verdict::kLacking;
    kernels.advice =
        "pictures take several times as long as with AVX2 and differ from those of "
        "other machines by rounding";
  }
  return {processors,
          kernels,
          CheckMemory(),
          {"page size", HumanBytes(static_cast<uint64_t>(::sysconf(_SC_PAGE_SIZE))), Verdict::kGood,
           ""},
          CheckOpenFiles(),
          CheckSizes()};
}

}  // namespace fovea::cli
