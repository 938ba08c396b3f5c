#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <iterator>
#include <string>

#include <sched.h>

#include "engine/base/buffers.h"
#include "service/jobs/run_job.h"

/// fovea-job: does one job of fovead, which starts it; not for people. The request comes on the
/// standard input, reports go to the standard output.
namespace fovea::jobs {
namespace {

constexpr int kNice = 10;
constexpr int kLockDescriptor = 3;
std::atomic<bool> stop_asked = false;  // by a signal

struct Arguments {
  Kind kind = Kind::kIngestFiles;
  Folders folders;
  int threads = 0;
  pid_t parent = 0;
};

bool Parse(int argc, char** argv, Arguments* arguments) {
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string flag = argv[i];
    const std::string value = argv[i + 1];
    const int number = std::atoi(value.c_str());  // NOLINT(cert-err34-c): fovead wrote it
    if (flag == "--kind") {
      arguments->kind = static_cast<Kind>(number);
    } else if (flag == "--root") {
      arguments->folders.root = value;
    } else if (flag == "--ingest-root") {
      arguments->folders.ingest_root = value;
    } else if (flag == "--export-root") {
      arguments->folders.export_root = value;
    } else if (flag == "--threads") {
      arguments->threads = number;
    } else if (flag == "--parent") {
      arguments->parent = number;
    } else {
      return false;
    }
  }
  return argc > 1 && argc % 2 == 1;
}

/// Goes with the server, whatever becomes of it, and lets what people wait for go first.
void SetUpProcess(pid_t parent) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::fcntl(kLockDescriptor, F_SETFD, FD_CLOEXEC);  // not for the programs that this one starts
  if (parent != 0 && ::getppid() != parent) {     // it went before that
    ::_exit(1);
  }
  ::setpriority(PRIO_PROCESS, 0, kNice);
  const sched_param none{};
  ::sched_setscheduler(0, SCHED_BATCH, &none);
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error of its write
  struct sigaction action {};
  action.sa_handler = [](int) { stop_asked = true; };
  ::sigaction(SIGTERM, &action, nullptr);
}

void Tell(const Report& report) {
  const std::string line = ToLine(report);
  for (size_t at = 0; at < line.size();) {
    const ssize_t written = ::write(STDOUT_FILENO, line.data() + at, line.size() - at);
    if (written < 0 && errno != EINTR) {
      return;
    }
    at += written > 0 ? static_cast<size_t>(written) : 0;
  }
}

int Main(int argc, char** argv) {
  Arguments arguments;
  if (!Parse(argc, argv, &arguments)) {
    std::cerr << "fovea-job does the jobs of fovead, which starts it\n";
    return 2;
  }
  SetUpProcess(arguments.parent);
  if (arguments.kind == Kind::kIngestFiles) {
    KeepFreedMemory();
  }
  const std::string request{std::istreambuf_iterator<char>(std::cin), {}};
  const Status status = RunJob(arguments.kind, request, arguments.folders, arguments.threads,
                               {Tell, [] { return stop_asked.load(); }});
  Tell(EndReport{status});
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace fovea::jobs

int main(int argc, char** argv) {
  return fovea::jobs::Main(argc, argv);
}
