#include "ingest/worker/system_call_filter.h"

#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <vector>

#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/sched.h>
#include <linux/seccomp.h>

namespace fovea::ingest {
namespace {

#if defined(__x86_64__)
constexpr uint32_t kProcessor = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr uint32_t kProcessor = AUDIT_ARCH_AARCH64;
#else
constexpr uint32_t kProcessor = 0;
#endif

/// Allowed whatever their arguments. What names a path is Landlock's business; nothing here opens,
/// writes to the disk, or reaches another process.
constexpr long kAllowed[] = {
    // What is open: the socket, and files that were opened for reading.
    SYS_read,
    SYS_readv,
    SYS_pread64,
    SYS_preadv,
    SYS_preadv2,
    SYS_write,
    SYS_writev,
    SYS_lseek,
    SYS_close,
    SYS_fstat,
    SYS_newfstatat,
    SYS_statx,
    SYS_faccessat,
    SYS_faccessat2,
    SYS_readlinkat,
    SYS_getcwd,
    SYS_getdents64,
    SYS_fadvise64,
    SYS_dup,
    SYS_dup3,
    SYS_fcntl,
    SYS_sendto,
    SYS_sendmsg,
    SYS_recvfrom,
    SYS_recvmsg,
    SYS_shutdown,
    SYS_ppoll,
    SYS_pselect6,
    // Memory.
    SYS_munmap,
    SYS_mremap,
    SYS_madvise,
    SYS_brk,
    // Threads.
    SYS_futex,
    SYS_futex_waitv,
    SYS_set_robust_list,
    SYS_get_robust_list,
    SYS_rseq,
    SYS_set_tid_address,
    SYS_membarrier,
    SYS_gettid,
    SYS_getpid,
    SYS_getppid,
    SYS_sched_yield,
    SYS_sched_getaffinity,
    SYS_sched_getparam,
    SYS_sched_getscheduler,
    SYS_exit,
    SYS_exit_group,
    SYS_rt_sigaction,
    SYS_rt_sigprocmask,
    SYS_rt_sigreturn,
    SYS_sigaltstack,
    SYS_restart_syscall,
    // The clock, and what the machine has.
    SYS_clock_gettime,
    SYS_clock_getres,
    SYS_clock_nanosleep,
    SYS_nanosleep,
    SYS_gettimeofday,
    SYS_times,
    SYS_getrusage,
    SYS_getrlimit,
    SYS_sysinfo,
    SYS_uname,
    SYS_getrandom,
    SYS_getuid,
    SYS_geteuid,
    SYS_getgid,
    SYS_getegid,
#if defined(__x86_64__)  // the older forms, which newer processors never had
    SYS_stat,
    SYS_lstat,
    SYS_access,
    SYS_readlink,
    SYS_dup2,
    SYS_poll,
    SYS_select,
    SYS_time,
#endif
};

/// Writes the filter, in the kernel's own little language (linux/filter.h): one instruction after
/// the other on one accumulator, jumps forward only.
class Assembler {
 public:
  void Load(size_t offset) {
    program_.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<uint32_t>(offset)));
  }
  /// The lower half of an argument: all that the flags below occupy.
  void LoadArgument(size_t index) {
    Load(offsetof(seccomp_data, args) + index * sizeof(uint64_t));  // little-endian
  }
  void And(uint32_t mask) { program_.push_back(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, mask)); }
  void SkipUnlessEqual(uint32_t value, uint8_t count) {
    program_.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, count));
  }
  void Return(uint32_t action) { program_.push_back(BPF_STMT(BPF_RET | BPF_K, action)); }

  void ReturnIfEqual(uint32_t value, uint32_t action) {
    SkipUnlessEqual(value, 1);
    Return(action);
  }
  void ReturnUnlessEqual(uint32_t value, uint32_t action) {
    program_.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 1, 0));
    Return(action);
  }
  /// `call` is allowed if its argument, masked, is one of `values`.
  void AllowIf(long call, size_t argument, uint32_t mask, std::initializer_list<uint32_t> values) {
    constexpr size_t kBesides = 3;  // load, mask, final refusal
    SkipUnlessEqual(static_cast<uint32_t>(call),
                    static_cast<uint8_t>(kBesides + 2 * values.size()));
    LoadArgument(argument);
    And(mask);
    for (const uint32_t value : values) {
      ReturnIfEqual(value, SECCOMP_RET_ALLOW);
    }
    Return(kRefused);
  }
  [[nodiscard]] std::vector<sock_filter>& program() { return program_; }

  static constexpr uint32_t kRefused = SECCOMP_RET_ERRNO | EPERM;

 private:
  std::vector<sock_filter> program_;
};

std::vector<sock_filter> MakeFilter() {
  constexpr uint32_t kAll = 0xFFFFFFFF;
  constexpr uint32_t kWriting = O_ACCMODE | O_CREAT | O_TRUNC;
  constexpr uint32_t kThread = CLONE_THREAD | CLONE_VM | CLONE_SIGHAND;
  const auto self = static_cast<uint32_t>(::getpid());
  Assembler code;
  code.Load(offsetof(seccomp_data, arch));
  code.ReturnUnlessEqual(kProcessor, SECCOMP_RET_KILL_PROCESS);  // another processor's numbers
  code.Load(offsetof(seccomp_data, nr));
  for (const long call : kAllowed) {
    code.ReturnIfEqual(static_cast<uint32_t>(call), SECCOMP_RET_ALLOW);
  }
  code.AllowIf(SYS_openat, 2, kWriting, {O_RDONLY});
#if defined(__x86_64__)
  code.AllowIf(SYS_open, 1, kWriting, {O_RDONLY});
#endif
  code.AllowIf(SYS_mmap, 2, PROT_EXEC, {0});
  code.AllowIf(SYS_mprotect, 2, PROT_EXEC, {0});
  code.AllowIf(SYS_clone, 0, kThread, {kThread});
  code.AllowIf(SYS_tgkill, 0, kAll, {self});  // abort
  code.AllowIf(SYS_prlimit64, 0, kAll, {0});  // its own
  code.AllowIf(SYS_setrlimit, 0, kAll, {RLIMIT_CPU});
  code.AllowIf(SYS_prctl, 0, kAll, {PR_SET_NAME, PR_GET_NAME});
  code.AllowIf(SYS_ioctl, 1, kAll, {TCGETS, FIONREAD});
  code.ReturnIfEqual(SYS_clone3, SECCOMP_RET_ERRNO | ENOSYS);
  code.Return(Assembler::kRefused);
  return std::move(code.program());
}

}  // namespace

bool HasSystemCallFilter() {
  const uint32_t action = SECCOMP_RET_KILL_PROCESS;
  return kProcessor != 0 && ::syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0;
}

Status FilterSystemCalls() {
  std::vector<sock_filter> filter = MakeFilter();
  const sock_fprog program{static_cast<unsigned short>(filter.size()), filter.data()};
  if (::syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &program) != 0) {
    return Internal("cannot confine the worker: seccomp: {}", std::strerror(errno));
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
