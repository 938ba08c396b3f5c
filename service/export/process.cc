#include "service/export/process.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <system_error>
#include <utility>

#include <spawn.h>

extern char** environ;

namespace fovea::exports {
namespace {

constexpr off_t kOutputLimit = 1 << 20;
constexpr off_t kErrorLimit = 4 << 10;

void CloseDescriptor(int* descriptor) {
  if (*descriptor >= 0) {
    ::close(std::exchange(*descriptor, -1));
  }
}

/// `limit` bytes of a memory file, from its start or its end.
std::string ReadMemoryFile(int descriptor, off_t limit, bool from_end) {
  struct stat info {};
  if (::fstat(descriptor, &info) != 0) {
    return "";
  }
  const off_t length = std::min(info.st_size, limit);
  std::string text(static_cast<size_t>(length), '\0');
  const ssize_t read =
      ::pread(descriptor, text.data(), text.size(), from_end ? info.st_size - length : 0);
  text.resize(read < 0 ? 0 : static_cast<size_t>(read));
  return text;
}

int SpawnWith(const std::vector<std::string>& arguments, int input, int output, int errors,
              int* process) {
  std::vector<char*> argv;
  for (const std::string& argument : arguments) {
    argv.push_back(const_cast<char*>(argument.c_str()));
  }
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&files, errors, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t defaults;
  sigemptyset(&defaults);
  for (const int signal : {SIGPIPE, SIGINT, SIGTERM, SIGXFSZ}) {
    sigaddset(&defaults, signal);
  }
  posix_spawnattr_setsigdefault(&attributes, &defaults);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  const int error = posix_spawnp(process, argv[0], &files, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  return error;
}

int WaitFor(int process) {
  int state = 0;
  while (::waitpid(process, &state, 0) < 0) {
    if (errno != EINTR) {
      return 127;
    }
  }
  return WIFEXITED(state) ? WEXITSTATUS(state) : 128 + WTERMSIG(state);
}

}  // namespace

StatusOr<FedProgram> FedProgram::Start(const std::vector<std::string>& arguments) {
  FedProgram program;
  std::array<int, 2> pipe{-1, -1};
  if (::pipe2(pipe.data(), O_CLOEXEC) != 0) {
    return ResourceExhausted("cannot start {}: no pipe: {}", arguments[0],
                             std::generic_category().message(errno));
  }
  program.input_ = pipe[1];
  program.output_ = ::memfd_create("fovea-stdout", MFD_CLOEXEC);
  program.errors_ = ::memfd_create("fovea-stderr", MFD_CLOEXEC);
  int error = errno;
  if (program.output_ >= 0 && program.errors_ >= 0) {
    error = SpawnWith(arguments, pipe[0], program.output_, program.errors_, &program.process_);
  }
  CloseDescriptor(pipe.data());
  if (error == ENOENT) {
    return NotFound("the program '{}' is not installed, or not on the PATH", arguments[0]);
  }
  if (error != 0) {
    return ResourceExhausted("cannot start {}: {}", arguments[0],
                             std::generic_category().message(error));
  }
  return program;
}

FedProgram::FedProgram(FedProgram&& other) noexcept
    : process_(std::exchange(other.process_, -1)),
      input_(std::exchange(other.input_, -1)),
      output_(std::exchange(other.output_, -1)),
      errors_(std::exchange(other.errors_, -1)) {}

FedProgram::~FedProgram() {
  if (process_ > 0) {
    ::kill(process_, SIGKILL);
    (void)WaitFor(process_);
  }
  CloseDescriptor(&input_);
  CloseDescriptor(&output_);
  CloseDescriptor(&errors_);
}

bool FedProgram::Write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(input_, bytes.data(), bytes.size());
    if (written < 0 && errno != EINTR) {
      return false;
    }
    bytes.remove_prefix(written < 0 ? 0 : static_cast<size_t>(written));
  }
  return true;
}

ProgramResult FedProgram::Finish() {
  CloseDescriptor(&input_);
  ProgramResult result{127, "", ""};
  if (process_ <= 0) {
    return result;
  }
  result.exit_status = WaitFor(std::exchange(process_, -1));
  result.output = ReadMemoryFile(output_, kOutputLimit, /*from_end=*/false);
  result.errors = ReadMemoryFile(errors_, kErrorLimit, /*from_end=*/true);
  result.errors.resize(result.errors.find_last_not_of(" \n") + 1);
  return result;
}

StatusOr<ProgramResult> RunProgram(const std::vector<std::string>& arguments) {
  FOVEA_ASSIGN_OR_RETURN(FedProgram program, FedProgram::Start(arguments));
  return program.Finish();
}

}  // namespace fovea::exports
