#ifndef SERVICE_EXPORT_PROCESS_H_
#define SERVICE_EXPORT_PROCESS_H_

#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"

namespace fovea::exports {

struct ProgramResult {
  int exit_status = 0;  // 128 + signal if one ended it
  std::string output;   // stdout, at most the first 1 MiB
  std::string errors;   // stderr, at most the last 4 KiB, without blanks at the end
};

/// A program that is fed through its standard input. It runs in a process group of its own, so
/// that Ctrl-C on the terminal reaches only us; destroying a running one ends it. The caller's
/// process must ignore SIGPIPE. Not thread-safe.
class FedProgram {
 public:
  /// `arguments[0]` is looked up on the PATH; no shell is involved. NOT_FOUND if it is not there.
  [[nodiscard]] static StatusOr<FedProgram> Start(const std::vector<std::string>& arguments);
  FedProgram(FedProgram&& other) noexcept;
  FedProgram& operator=(FedProgram&&) = delete;
  ~FedProgram();

  /// False if the program reads no more: Finish tells why.
  [[nodiscard]] bool Write(std::string_view bytes);
  /// Ends its input and waits for it; once.
  [[nodiscard]] ProgramResult Finish();

 private:
  FedProgram() = default;

  int process_ = -1;
  int input_ = -1;
  int output_ = -1, errors_ = -1;  // memory files
};

/// Runs a program without input to its end.
[[nodiscard]] StatusOr<ProgramResult> RunProgram(const std::vector<std::string>& arguments);

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_PROCESS_H_
