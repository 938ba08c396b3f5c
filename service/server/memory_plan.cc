#include "service/server/memory_plan.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <string_view>
#include <utility>

namespace fovea::server {
namespace {

constexpr int64_t kMiB = int64_t{1} << 20;
constexpr int64_t kProgramBytes = 256 * kMiB;
constexpr int64_t kLeastBytes = 512 * kMiB;
constexpr int64_t kMostTransportBytes = 512 * kMiB;
constexpr int64_t kMostRequestBytes = 512 * kMiB;
constexpr double kMostBytes = 9e18;

constexpr std::array<std::pair<std::string_view, double>, 10> kUnits{{{"", 1},
                                                                      {"KB", 1e3},
                                                                      {"MB", 1e6},
                                                                      {"GB", 1e9},
                                                                      {"TB", 1e12},
                                                                      {"KiB", 1024.0},
                                                                      {"MiB", 1048576.0},
                                                                      {"GiB", 1073741824.0},
                                                                      {"TiB", 1099511627776.0},
                                                                      {"B", 1}}};

}  // namespace

StatusOr<MemoryPlan> MemoryPlan::Divide(int64_t limit_bytes) {
  if (limit_bytes < kLeastBytes) {
    return ResourceExhausted("--memory-limit: {} MiB are too little to serve with; give {} or more",
                             limit_bytes / kMiB, kLeastBytes / kMiB);
  }
  MemoryPlan plan;
  plan.program = kProgramBytes;
  const int64_t rest = limit_bytes - plan.program;
  plan.transport = std::min(kMostTransportBytes, rest / 8);
  plan.requests = std::min(kMostRequestBytes, rest / 8);
  plan.volumes = rest / 4;
  plan.replies = rest / 4;
  plan.rendering = rest - plan.transport - plan.requests - plan.volumes - plan.replies;
  return plan;
}

StatusOr<int64_t> ParseMemoryLimit(const std::string& text, int64_t machine_bytes) {
  double amount = 0;
  const char* last = text.data() + text.size();
  const auto [end, error] = std::from_chars(text.data(), last, amount);
  const std::string_view unit(end, static_cast<size_t>(last - end));
  const bool is_number = error == std::errc() && std::isfinite(amount) && amount > 0;
  if (is_number && unit == "%" && amount <= 100) {
    return static_cast<int64_t>(amount / 100 * static_cast<double>(machine_bytes));
  }
  for (const auto& [name, bytes] : kUnits) {
    if (is_number && unit == name && amount * bytes < kMostBytes) {
      return static_cast<int64_t>(amount * bytes);
    }
  }
  return InvalidArgument(
      "--memory-limit: '{}' is neither a share of this machine's memory up to 100%, like 50%, nor "
      "an amount like 16GB or 512MiB",
      text);
}

int64_t MachineBytes() {
  int64_t bytes = static_cast<int64_t>(sysconf(_SC_PHYS_PAGES)) * sysconf(_SC_PAGESIZE);
  int64_t group_bytes = 0;  // "max" does not read as a number
  if (std::ifstream("/sys/fs/cgroup/memory.max") >> group_bytes && group_bytes > 0) {
    bytes = std::min(bytes, group_bytes);
  }
  return bytes;
}

}  // namespace fovea::server
