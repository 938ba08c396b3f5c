#include "service/jobs/job_process.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include <poll.h>
#include <spawn.h>

#include "ingest/program_path.h"

namespace fovea::jobs {
namespace {

constexpr int kLockDescriptor = 3;
constexpr size_t kMaxLineBytes = 1 << 20;

/// A file without a name that holds `bytes`, to be read from its start; -1 if there is no memory.
int MemoryFile(const std::string& bytes) {
  const int file = ::memfd_create("job", MFD_CLOEXEC);
  for (size_t at = 0; file >= 0 && at < bytes.size();) {
    const ssize_t written = ::write(file, bytes.data() + at, bytes.size() - at);
    if (written < 0 && errno != EINTR) {
      ::close(file);
      return -1;
    }
    at += written > 0 ? static_cast<size_t>(written) : 0;
  }
  if (file >= 0) {
    ::lseek(file, 0, SEEK_SET);
  }
  return file;
}

/// Starts a program in a process group of its own, with signals as a fresh process has them but for
/// SIGXFSZ and SIGPIPE, which are ignored as they are here.
StatusOr<pid_t> Spawn(std::vector<std::string> texts, int input, int output, int lock) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  if (lock >= 0) {
    ::posix_spawn_file_actions_adddup2(&actions, lock, kLockDescriptor);
  }
  ::posix_spawn_file_actions_addclosefrom_np(&actions, kLockDescriptor + (lock >= 0 ? 1 : 0));
  sigset_t none;
  sigset_t defaults;
  ::sigemptyset(&none);
  ::sigfillset(&defaults);
  ::sigdelset(&defaults, SIGXFSZ);
  ::sigdelset(&defaults, SIGPIPE);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(
      &attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  std::vector<char*> arguments;
  for (std::string& text : texts) {
    arguments.push_back(text.data());
  }
  arguments.push_back(nullptr);
  pid_t pid = 0;
  const int error =
      ::posix_spawn(&pid, arguments[0], &actions, &attributes, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (error != 0) {
    return Unavailable("cannot start '{}': {}", texts[0], std::strerror(error));
  }
  return pid;
}

}  // namespace

StatusOr<std::unique_ptr<JobProcess>> JobProcess::Start(const Job& job,
                                                        const ProcessOptions& options) {
  std::string program = options.program;
  if (program.empty()) {
    FOVEA_ASSIGN_OR_RETURN(program, ingest::FindProgram("fovea-job"));
  }
  const int input = MemoryFile(job.request);
  int pipes[2] = {-1, -1};
  if (input < 0 || ::pipe2(pipes, O_CLOEXEC) != 0) {
    const Status status = Unavailable("cannot start '{}': {}", program, std::strerror(errno));
    ::close(input);
    return status;
  }
  const Folders& folders = options.folders;
  const auto pid =
      Spawn({program, "--kind", std::to_string(static_cast<int>(job.kind)), "--root", folders.root,
             "--ingest-root", folders.ingest_root, "--export-root", folders.export_root,
             "--threads", std::to_string(options.threads), "--parent", std::to_string(::getpid())},
            input, pipes[1], options.lock_fd);
  ::close(input);
  ::close(pipes[1]);
  if (!pid.ok()) {
    ::close(pipes[0]);
    return pid.status();
  }
  ::fcntl(pipes[0], F_SETFL, O_NONBLOCK);
  return std::unique_ptr<JobProcess>(new JobProcess(*pid, pipes[0]));
}

JobProcess::~JobProcess() {
  Kill();
  static_cast<void>(Reap());
  ::close(output_);
}

void JobProcess::AskToStop() {
  if (pid_ > 0) {
    ::kill(pid_, SIGTERM);
  }
}

void JobProcess::Kill() {
  if (pid_ > 0) {
    ::kill(-pid_, SIGKILL);
  }
}

bool JobProcess::ReadSome() {
  char buffer[16384];
  while (true) {
    const ssize_t size = ::read(output_, buffer, sizeof(buffer));
    if (size < 0 && errno == EINTR) {
      continue;
    }
    if (size < 0) {
      return true;  // nothing now
    }
    if (size == 0) {
      return false;
    }
    unread_.append(buffer, static_cast<size_t>(size));
    if (unread_.size() > kMaxLineBytes) {
      return true;  // lines are taken out before more is read
    }
  }
}

std::vector<Report> JobProcess::Wait(std::chrono::milliseconds limit) {
  pollfd entry{output_, POLLIN, 0};
  ::poll(&entry, 1, static_cast<int>(limit.count()));
  const bool more = ReadSome();
  std::vector<Report> reports;
  size_t begin = 0;
  for (size_t end = 0; (end = unread_.find('\n', begin)) != std::string::npos; begin = end + 1) {
    if (auto report = FromLine(std::string_view(unread_).substr(begin, end - begin))) {
      reports.push_back(*std::move(report));
    }
  }
  unread_.erase(0, begin);
  if (!more) {
    Status status = Reap();
    if (reports.empty() || !std::holds_alternative<EndReport>(reports.back())) {
      reports.emplace_back(EndReport{std::move(status)});
    }
  } else if (!reports.empty() && std::holds_alternative<EndReport>(reports.back())) {
    static_cast<void>(Reap());
  }
  return reports;
}

/// How it ended, for one that did not say so itself.
Status JobProcess::Reap() {
  int status = 0;
  while (pid_ > 0 && ::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  pid_ = 0;
  if (WIFSIGNALED(status)) {
    return Internal("the process of the job died of signal {} ({}){}", WTERMSIG(status),
                    ::sigdescr_np(WTERMSIG(status)),
                    WTERMSIG(status) == SIGKILL ? "; the machine may have run out of memory" : "");
  }
  return Internal("the process of the job ended early, with exit status {}", WEXITSTATUS(status));
}

}  // namespace fovea::jobs
