#include "ingest/worker_client.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <limits>
#include <utility>

#include <poll.h>
#include <spawn.h>

#include "engine/base/parallel.h"
#include "ingest/program_path.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kBaseMemoryBytes = 512 << 20;
constexpr int64_t kPictureModuleBytes = int64_t{1} << 30;  // OpenImageIO's 260 libraries
constexpr int kReapMs = 2000;
constexpr size_t kAttachmentPieceBytes = 1 << 20;

constexpr double kMaxSeconds = 1e7;

double SecondsPerFile(const WorkerLimits& limits) {
  return std::clamp(limits.seconds_per_file, 0.0, kMaxSeconds);
}

int64_t ProcessorSecondsPerFile(const WorkerLimits& limits) {
  const double seconds =
      limits.cpu_seconds_per_file.value_or((SecondsPerFile(limits) + 1) * HardwareThreads());
  return static_cast<int64_t>(std::ceil(std::clamp(seconds, 1.0, kMaxSeconds * 1024)));
}

[[maybe_unused]] int64_t MachineMemoryBytes() {  // no limit in sanitizer builds
  const int64_t pages = ::sysconf(_SC_PHYS_PAGES);
  const int64_t page_bytes = ::sysconf(_SC_PAGE_SIZE);
  return pages > 0 && page_bytes > 0 ? pages * page_bytes : int64_t{4} << 30;
}

/// Starts `program` with `socket` as its standard input, `slabs` as kSlabDescriptor, nothing else
/// inherited, in a process group of its own (Ctrl-C is for us: we stop between steps), with signals
/// as a fresh process has them.
StatusOr<pid_t> Spawn(const std::string& program, const std::vector<std::string>& arguments,
                      int socket, int slabs) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_adddup2(&actions, socket, STDIN_FILENO);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
#ifndef FOVEA_SANITIZED  // a sanitizer's report must reach somebody
  ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
#endif
  ::posix_spawn_file_actions_adddup2(&actions, slabs, kSlabDescriptor);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, kSlabDescriptor + 1);
  sigset_t none;
  sigset_t all;
  ::sigemptyset(&none);
  ::sigfillset(&all);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &all);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(
      &attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);

  std::vector<std::string> texts{program};
  texts.insert(texts.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& text : texts) {
    argv.push_back(text.data());
  }
  argv.push_back(nullptr);
  pid_t pid = 0;
  const int error =
      ::posix_spawn(&pid, program.c_str(), &actions, &attributes, argv.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (error != 0) {
    return Unavailable("cannot start '{}': {}", program, std::strerror(error));
  }
  return pid;
}

/// Waits a moment for `pid` to end by itself, so that its own exit status is seen, then kills it.
int Reap(pid_t pid) {
  const int handle = static_cast<int>(::syscall(SYS_pidfd_open, pid, 0));
  if (handle >= 0) {
    pollfd entry{handle, POLLIN, 0};
    while (::poll(&entry, 1, kReapMs) < 0 && errno == EINTR) {
    }
    ::close(handle);
  }
  ::kill(pid, SIGKILL);
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

}  // namespace

int64_t WorkerMemoryBytes(const WorkerOptions& options) {
#ifdef FOVEA_SANITIZED
  static_cast<void>(options);
  return 0;
#else
  if (options.limits.memory_bytes) {
    return *options.limits.memory_bytes;
  }
  const int64_t machine = std::max(MachineMemoryBytes(), kBaseMemoryBytes);
  const int64_t declared = std::clamp<int64_t>(options.declared_bytes, 0, machine);
  const int64_t module = options.pictures ? kPictureModuleBytes : 0;
  return std::min(machine, kBaseMemoryBytes + module + 3 * declared);
#endif
}

Status WorkerClient::Start(Channel::Deadline deadline) {
  is_ready_ = false;
  program_ = options_.program;
  if (program_.empty()) {
    FOVEA_ASSIGN_OR_RETURN(program_,
                           FindProgram(options_.openvdb ? "fovea-vdb-worker" : "fovea-worker"));
  }
  FOVEA_ASSIGN_OR_RETURN(std::unique_ptr<SlabRing> slabs, SlabRing::Make());
  int sockets[2] = {-1, -1};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets) != 0) {
    return Unavailable("cannot make a socket pair: {}", std::strerror(errno));
  }
  channel_ = std::make_unique<Channel>(sockets[0]);
  const auto pid = Spawn(program_,
                         {"--memory-bytes", std::to_string(WorkerMemoryBytes(options_)),
                          "--cpu-seconds", std::to_string(ProcessorSecondsPerFile(options_.limits)),
                          "--dies-with-thread", options_.dies_with_thread ? "1" : "0"},
                         sockets[1], slabs->descriptor());
  ::close(sockets[1]);
  slabs->CloseDescriptor();
  channel_->Attach(std::move(slabs));
  FOVEA_RETURN_IF_ERROR(pid.status());
  {
    const std::lock_guard lock(pid_mutex_);
    pid_ = *pid;
  }
  return Annotate(Introduce(deadline), program_);
}

/// Tells the worker what it may read.
Status WorkerClient::Introduce(Channel::Deadline deadline) {
  readable_.clear();
  for (const std::string& path : options_.files) {
    readable_.emplace(path, Identify(path));
  }
  for (const Frame& frame : EncodeFiles(options_.files)) {
    FOVEA_RETURN_IF_ERROR(channel_->Send(frame, deadline));
  }
  FOVEA_RETURN_IF_ERROR(channel_->Send(Encode(BeginRequest{options_.pictures}), deadline));
  return channel_->Flush(deadline);
}

/// Waits until the worker can read nothing else.
Status WorkerClient::ReceiveHello(Channel::Deadline deadline) {
  FOVEA_ASSIGN_OR_RETURN(const FrameView reply, channel_->Receive(deadline));
  if (reply.kind == FrameKind::kError) {
    return DecodeError(reply);
  }
  FOVEA_ASSIGN_OR_RETURN(hello_, DecodeHello(reply));
  is_ready_ = true;
  return absl::OkStatus();
}

Status WorkerClient::MakeReady(Channel::Deadline deadline) {
  ForgetIfDead();
  if (channel_ == nullptr) {
    FOVEA_RETURN_IF_ERROR(Start(deadline));
  }
  return is_ready_ ? absl::OkStatus() : Annotate(ReceiveHello(deadline), program_);
}

void WorkerClient::Prepare() {
  if (channel_ == nullptr && !Start(NewDeadline()).ok()) {
    Stop();  // the next call tries again, and tells
  }
}

bool WorkerClient::Suits(const WorkerOptions& options) const {
  return options.program == options_.program && options.pictures == options_.pictures &&
         options.openvdb == options_.openvdb &&
         options.dies_with_thread == options_.dies_with_thread &&
         WorkerMemoryBytes(options) <= WorkerMemoryBytes(options_);
}

WorkerClient::FileIdentity WorkerClient::Identify(const std::string& path) {
  struct stat about {};
  return ::stat(path.c_str(), &about) == 0 ? FileIdentity{about.st_dev, about.st_ino}
                                           : FileIdentity{};
}

void WorkerClient::Allow(const std::vector<std::string>& files) {
  bool is_confined_without = false;
  for (const std::string& path : files) {
    const auto known = readable_.find(path);
    if (known != readable_.end() && known->second == Identify(path)) {
      continue;
    }
    is_confined_without = true;
    if (std::find(options_.files.begin(), options_.files.end(), path) == options_.files.end()) {
      options_.files.push_back(path);
    }
  }
  if (is_confined_without && pid() != 0) {
    Stop();
  }
}

Status WorkerClient::Exchange(const Frame& request, std::string_view attachment,
                              const std::function<Status(const FrameView&)>& on_reply,
                              bool* is_clean) {
  FOVEA_RETURN_IF_ERROR(MakeReady(deadline_));
  FOVEA_RETURN_IF_ERROR(channel_->Send(request, deadline_));
  for (size_t begin = 0; begin < attachment.size(); begin += kAttachmentPieceBytes) {
    const Frame piece{FrameKind::kBytes,
                      std::string(attachment.substr(begin, kAttachmentPieceBytes))};
    FOVEA_RETURN_IF_ERROR(channel_->Send(piece, deadline_));
  }
  FOVEA_RETURN_IF_ERROR(channel_->Flush(deadline_));
  while (true) {
    FOVEA_ASSIGN_OR_RETURN(const FrameView reply, channel_->Receive(deadline_));
    if (reply.kind == FrameKind::kError || reply.kind == FrameKind::kEnd) {
      *is_clean = true;
      return reply.kind == FrameKind::kEnd ? absl::OkStatus() : DecodeError(reply);
    }
    FOVEA_RETURN_IF_ERROR(HandOut(reply, on_reply));
    if (std::chrono::steady_clock::now() > deadline_) {  // a worker that never stops talking
      return DeadlineExceeded("no end in time");
    }
  }
}

Status WorkerClient::HandOut(const FrameView& reply,
                             const std::function<Status(const FrameView&)>& on_reply) {
  if (reply.kind != FrameKind::kSlab) {
    return on_reply(reply);
  }
  FOVEA_ASSIGN_OR_RETURN(const SlabRows rows, DecodeSlabRows(reply));
  FOVEA_RETURN_IF_ERROR(on_reply(reply));
  FOVEA_RETURN_IF_ERROR(channel_->Send(EncodeSlabFree(rows.slab), deadline_));
  return channel_->Flush(deadline_);
}

Channel::Deadline WorkerClient::NewDeadline() const {
  return std::chrono::steady_clock::now() +
         std::chrono::duration_cast<std::chrono::steady_clock::duration>(
             std::chrono::duration<double>(SecondsPerFile(options_.limits)));
}

Status WorkerClient::Call(const std::string& about, const Frame& request,
                          std::string_view attachment,
                          const std::function<Status(const FrameView&)>& on_reply) {
  bool is_clean = false;
  deadline_ = NewDeadline();
  Status status = Exchange(request, attachment, on_reply, &is_clean);
  if (!is_clean) {
    status = GiveUp(status);
  }
  return Annotate(status, about);
}

StatusOr<Hello> WorkerClient::Greet() {
  const Status status = MakeReady(NewDeadline());
  return status.ok() ? StatusOr<Hello>(hello_) : GiveUp(status);
}

Status WorkerClient::GiveUp(const Status& status) {
  Status reason = status;
  if (absl::IsUnavailable(status) && pid() != 0) {
    reason = DescribeDeath();
  } else if (absl::IsDeadlineExceeded(status)) {
    reason = DeadlineExceeded(
        "reading it took longer than {} seconds and was stopped; the file may be damaged (allow "
        "more with --worker-seconds)",
        options_.limits.seconds_per_file);
  }
  Stop();
  return reason;
}

/// Libraries may crash where memory is short, or not even load.
std::string WorkerClient::OrShortOfMemory() const {
  const int64_t bytes = WorkerMemoryBytes(options_);
  return bytes == 0
             ? ""
             : fmt::format(", or reading it needs more than {} MB (--worker-memory)", bytes >> 20);
}

Status WorkerClient::DescribeDeath() {
  channel_.reset();
  const int status = Reap(TakePid());
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    if (signal == SIGXCPU) {
      return DeadlineExceeded(
          "reading it took more than {} seconds of processor time and was stopped; the file may be "
          "damaged (allow more with --worker-cpu-seconds)",
          ProcessorSecondsPerFile(options_.limits));
    }
    return DataLoss(
        "the worker that reads it died of signal {} ({}); the file is probably damaged{}", signal,
        ::sigdescr_np(signal) == nullptr ? "unknown" : ::sigdescr_np(signal), OrShortOfMemory());
  }
  return DataLoss(
      "the worker that reads it ended early, with exit status {}; the file is probably damaged{}",
      WEXITSTATUS(status), OrShortOfMemory());
}

void WorkerClient::ForgetIfDead() {
  int status = 0;
  if (pid() != 0 && ::waitpid(pid(), &status, WNOHANG) != 0) {
    TakePid();
    channel_.reset();
  }
}

void WorkerClient::Stop() {
  channel_.reset();
  Interrupt();
  if (const pid_t pid = TakePid(); pid != 0) {
    Reap(pid);
  }
}

void WorkerClient::Interrupt() {
  const std::lock_guard lock(pid_mutex_);
  if (pid_ != 0) {
    ::kill(pid_, SIGKILL);
  }
}

pid_t WorkerClient::pid() const {
  const std::lock_guard lock(pid_mutex_);
  return pid_;
}

pid_t WorkerClient::TakePid() {
  const std::lock_guard lock(pid_mutex_);
  return std::exchange(pid_, 0);
}

}  // namespace fovea::ingest
