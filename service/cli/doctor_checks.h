#ifndef SERVICE_CLI_DOCTOR_CHECKS_H_
#define SERVICE_CLI_DOCTOR_CHECKS_H_

#include <cstdint>
#include <string>
#include <vector>

namespace fovea::cli {

enum class Verdict {
  kGood,
  kLacking,  // works, with less
  kMissing,  // something does not work without it
};

/// One thing that was looked at.
struct Finding {
  std::string about;  // "Landlock"
  std::string found;  // for people: "ABI 7"
  Verdict verdict = Verdict::kGood;
  std::string advice;  // what to do; empty if all is well
};

/// Processors, instruction sets, memory, limits of this process.
[[nodiscard]] std::vector<Finding> CheckMachine();
/// The sandbox that the kernel offers, and the programs and libraries that are started or loaded.
[[nodiscard]] std::vector<Finding> CheckPrograms();
/// Whether stores can be kept in `folder`: its file system, whether it locks, syncs and renames,
/// and what is free. Leaves nothing behind. A folder that cannot be written to is `kMissing` if
/// it `must_be_writable`.
[[nodiscard]] std::vector<Finding> CheckFolder(const std::string& folder, bool must_be_writable);

/// The least of the machine's memory and what the control groups of this process allow.
[[nodiscard]] int64_t UsableMemoryBytes();
/// `text` of memory.max or memory.limit_in_bytes; -1: no limit.
[[nodiscard]] int64_t ParseMemoryLimit(const std::string& text);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_DOCTOR_CHECKS_H_
