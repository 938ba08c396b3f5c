#include "ingest/worker/sandbox.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <netinet/in.h>

#include "ingest/worker/limits.h"
#include "tests/support/temporary_folder.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;

/// Runs `attempt` in a process of its own that confined itself to `files`, and returns what it
/// returned (0 to 99); negative: it died of that signal.
int InSandbox(const std::vector<std::string>& files, const std::function<int()>& attempt) {
  const pid_t child = ::fork();
  if (child == 0) {
    const rlimit no_core{0, 0};
    ::setrlimit(RLIMIT_CORE, &no_core);
    ::_exit(Confine(files).ok() ? attempt() : 99);
  }
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
}

/// 0: it succeeded; else errno.
int Outcome(long result) {
  return result >= 0 ? 0 : errno;
}

bool IsRefused(int outcome) {
  return outcome == EPERM || outcome == EACCES || outcome == ENOSYS;
}

class SandboxTest : public ::testing::Test {
 protected:
  void SetUp() override {
    WriteFile(inside_, "inside");
    WriteFile(outside_, "outside");
  }
  static void WriteFile(const std::string& path, const std::string& text) {
    std::ofstream(path) << text;
  }
  /// Why this cannot be tested here; empty if it can.
  [[nodiscard]] std::string LacksLandlock(int abi) const {
    return kernel_.landlock_abi >= abi
               ? ""
               : "needs Landlock of ABI " + std::to_string(abi) + "; this kernel's is " +
                     std::to_string(kernel_.landlock_abi);
  }
  [[nodiscard]] std::string LacksFilter() const {
#ifdef FOVEA_SANITIZED
    return "system calls are not filtered in builds with sanitizers";
#else
    return kernel_.system_calls_filtered
               ? ""
               : "this kernel has no seccomp, or this processor is not known";
#endif
  }
  void ExpectRefused(const char* what, const std::function<int()>& attempt) const {
    const int outcome = InSandbox({inside_}, attempt);
    EXPECT_TRUE(IsRefused(outcome)) << what << ": " << outcome;
  }

  const testing::TemporaryFolder folder_;
  const std::string inside_ = folder_.path() + "/inside.vdb";
  const std::string outside_ = folder_.path() + "/outside.vdb";
  const Confinement kernel_ = KernelConfinement();
};

TEST_F(SandboxTest, ReadsTheGivenFileAsBefore) {
  EXPECT_EQ(InSandbox({inside_},
                      [&] {
                        std::ifstream stream(inside_);
                        std::string text;
                        stream >> text;
                        return text == "inside" && fs::file_size(inside_) == 6 ? 0 : 1;
                      }),
            0);
}

TEST_F(SandboxTest, AFileThatIsNotThereIsNoErrorYet) {
  const std::string nowhere = folder_.path() + "/nowhere.vdb";
  EXPECT_EQ(
      InSandbox({nowhere, inside_}, [&] { return Outcome(::open(nowhere.c_str(), O_RDONLY)); }),
      ENOENT);
}

TEST_F(SandboxTest, ReadsNothingElse) {
  if (const std::string lack = LacksLandlock(1); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  const auto open = [](const std::string& path, int flags) {
    return [=] { return Outcome(::open(path.c_str(), flags, 0600)); };
  };
  ExpectRefused("another file of the folder", open(outside_, O_RDONLY));
  ExpectRefused("the folder", open(folder_.path(), O_RDONLY | O_DIRECTORY));
  ExpectRefused("/etc/passwd", open("/etc/passwd", O_RDONLY));
  ExpectRefused("a device", open("/dev/urandom", O_RDONLY));
  ExpectRefused("by way of a link", [&] {
    return Outcome(::open(
        (folder_.path() + "/../" + fs::path(folder_.path()).filename().string() + "/outside.vdb")
            .c_str(),
        O_RDONLY));
  });
#ifndef FOVEA_SANITIZED
  ExpectRefused("memory maps", open("/proc/self/maps", O_RDONLY));
#endif
}

TEST_F(SandboxTest, AFileThatTookTheNameOfAGivenOneIsNotRead) {
  if (const std::string lack = LacksLandlock(1); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  const pid_t child = ::fork();
  if (child == 0) {
    const bool confined = Confine(std::vector<std::string>{inside_}).ok();
    ::raise(SIGSTOP);
    ::_exit(confined ? Outcome(::open(inside_.c_str(), O_RDONLY)) : 99);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, WUNTRACED), child);
  ASSERT_TRUE(WIFSTOPPED(status));
  fs::rename(outside_, inside_);
  ::kill(child, SIGCONT);
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), EACCES);
}

TEST_F(SandboxTest, WritesNothing) {
  if (!LacksLandlock(1).empty() && !LacksFilter().empty()) {
    GTEST_SKIP() << LacksLandlock(1) << "; " << LacksFilter();
  }
  ExpectRefused("writing", [&] { return Outcome(::open(inside_.c_str(), O_WRONLY)); });
  ExpectRefused("both", [&] { return Outcome(::open(inside_.c_str(), O_RDWR)); });
  ExpectRefused("cutting", [&] { return Outcome(::open(inside_.c_str(), O_RDONLY | O_TRUNC)); });
  ExpectRefused("a new file", [&] {
    return Outcome(::open((folder_.path() + "/new").c_str(), O_CREAT | O_RDONLY, 0600));
  });
  ExpectRefused("removing", [&] { return Outcome(::unlink(inside_.c_str())); });
  ExpectRefused("renaming", [&] { return Outcome(::rename(inside_.c_str(), outside_.c_str())); });
  ExpectRefused("a folder",
                [&] { return Outcome(::mkdir((folder_.path() + "/d").c_str(), 0700)); });
  ExpectRefused("a link",
                [&] { return Outcome(::symlink("/etc", (folder_.path() + "/l").c_str())); });
  EXPECT_EQ(fs::file_size(inside_), 6);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 2);
}

TEST_F(SandboxTest, StartsNoProgram) {
  if (!LacksLandlock(1).empty() && !LacksFilter().empty()) {
    GTEST_SKIP() << LacksLandlock(1) << "; " << LacksFilter();
  }
  ExpectRefused("exec",
                [] { return Outcome(::execl("/bin/true", "true", static_cast<char*>(nullptr))); });
}

TEST_F(SandboxTest, TalksToNobody) {
  if (const std::string lack = LacksFilter(); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  for (const int family : {AF_INET, AF_INET6, AF_UNIX, AF_NETLINK, AF_PACKET}) {
    ExpectRefused("a socket", [=] { return Outcome(::socket(family, SOCK_STREAM, 0)); });
  }
  ExpectRefused("a pair", [] {
    int sockets[2];
    return Outcome(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets));
  });
}

TEST_F(SandboxTest, MakesNoProcessAndTouchesNoOther) {
  if (const std::string lack = LacksFilter(); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  ExpectRefused("fork", [] {
    const pid_t child = ::fork();
    if (child == 0) {
      ::_exit(0);
    }
    return Outcome(child);
  });
  ExpectRefused("vfork", [] { return Outcome(::syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0)); });
  ExpectRefused("clone3", [] { return Outcome(::syscall(SYS_clone3, nullptr, 0)); });
  ExpectRefused("ptrace", [] { return Outcome(::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr)); });
  ExpectRefused("its parent's memory", [] {
    return Outcome(::syscall(SYS_process_vm_readv, ::getppid(), nullptr, 0, nullptr, 0, 0));
  });
  ExpectRefused("kill", [] { return Outcome(::kill(::getppid(), 0)); });
  ExpectRefused("tgkill",
                [] { return Outcome(::syscall(SYS_tgkill, ::getppid(), ::getppid(), 0)); });
  ExpectRefused("another's limits", [] {
    rlimit limit{};
    return Outcome(::prlimit(::getppid(), RLIMIT_CPU, nullptr, &limit));
  });
}

TEST_F(SandboxTest, LoadsNoCode) {
  if (const std::string lack = LacksFilter(); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  constexpr size_t kPage = 4096;
  ExpectRefused("mmap", [] {
    void* page = ::mmap(nullptr, kPage, PROT_READ | PROT_WRITE | PROT_EXEC,
                        MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return page == MAP_FAILED ? errno : 0;
  });
  ExpectRefused("mprotect", [] {
    void* page = ::mmap(nullptr, kPage, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return page == MAP_FAILED ? 0 : Outcome(::mprotect(page, kPage, PROT_READ | PROT_EXEC));
  });
}

TEST_F(SandboxTest, ReachesNothingElseOfTheKernel) {
  if (const std::string lack = LacksFilter(); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  const std::pair<const char*, long> calls[] = {
      {"bpf", SYS_bpf},
      {"io_uring", SYS_io_uring_setup},
      {"keyctl", SYS_keyctl},
      {"add_key", SYS_add_key},
      {"mount", SYS_mount},
      {"unshare", SYS_unshare},
      {"setns", SYS_setns},
      {"userfaultfd", SYS_userfaultfd},
      {"perf_event_open", SYS_perf_event_open},
      {"openat2", SYS_openat2},
      {"open_by_handle_at", SYS_open_by_handle_at},
      {"chroot", SYS_chroot},
      {"memfd_create", SYS_memfd_create},
      {"ftruncate", SYS_ftruncate},
      {"setuid", SYS_setuid},
      {"seccomp", SYS_seccomp},
      {"personality", SYS_personality},
      {"inotify", SYS_inotify_init1},
      {"pidfd_open", SYS_pidfd_open},
      {"execveat", SYS_execveat},
      {"chmod", SYS_fchmodat},
      {"a call of the future", 5000},
  };
  for (const auto& [name, number] : calls) {
    ExpectRefused(name, [call = number] { return Outcome(::syscall(call, 0, 0, 0, 0, 0)); });
  }
  ExpectRefused("prctl", [] { return Outcome(::prctl(PR_SET_DUMPABLE, 0, 0, 0, 0)); });
  ExpectRefused("ioctl",
                [] { return Outcome(::syscall(SYS_ioctl, 0, 0x5412 /* TIOCSTI */, "x")); });
}

TEST_F(SandboxTest, ReachesNoTcpPort) {
  if (const std::string lack = LacksLandlock(4); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  // A socket that was open before: the filter of system calls does not see what it was opened for.
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(::bind(listener, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  ASSERT_EQ(::listen(listener, 1), 0);
  socklen_t size = sizeof(address);
  ASSERT_EQ(::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size), 0);
  const int open_before = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ExpectRefused("connect", [&] {
    return Outcome(::connect(open_before, reinterpret_cast<sockaddr*>(&address), sizeof(address)));
  });
  ::close(open_before);
  ::close(listener);
}

TEST_F(SandboxTest, ThreadsMemoryAndAbortWorkAsBefore) {
  EXPECT_EQ(InSandbox({inside_},
                      [&] {
                        std::vector<std::thread> threads;
                        std::vector<int64_t> sums(8, 0);
                        for (int64_t& sum : sums) {
                          threads.emplace_back([&sum] {
                            const std::vector<int64_t> ones(1 << 20, 1);
                            sum = std::accumulate(ones.begin(), ones.end(), int64_t{0});
                          });
                        }
                        for (std::thread& thread : threads) {
                          thread.join();
                        }
                        return sums == std::vector<int64_t>(8, 1 << 20) ? 0 : 1;
                      }),
            0);
#ifndef FOVEA_SANITIZED
  EXPECT_EQ(InSandbox({inside_},
                      [] {
                        std::abort();
                        return 0;
                      }),
            -SIGABRT);
#endif
}

TEST_F(SandboxTest, AThreadIsConfinedToo) {
  if (const std::string lack = LacksLandlock(1); !lack.empty()) {
    GTEST_SKIP() << lack;
  }
  int outcome = 0;
  EXPECT_EQ(InSandbox({inside_},
                      [&] {
                        std::thread([&] {
                          outcome = Outcome(::open(outside_.c_str(), O_RDONLY));
                        }).join();
                        return outcome;
                      }),
            EACCES);
}

TEST_F(SandboxTest, RootIsNoRootAnyMore) {
  if (::geteuid() != 0) {
    GTEST_SKIP() << "not root";
  }
  EXPECT_EQ(InSandbox({inside_},
                      [&] {
                        const rlimit one{1, 1};  // back from 0: takes CAP_SYS_RESOURCE
                        return Outcome(::prlimit(0, RLIMIT_CORE, &one, nullptr));
                      }),
            EPERM);
}

TEST(LimitsTest, ProcessorTimeEndsInSigxcpuEvenInTheSandbox) {
  EXPECT_EQ(InSandbox({},
                      [] {
                        if (!LimitProcessorTime(0).ok()) {
                          return 1;
                        }
                        for (volatile int64_t i = 0; i < INT64_MAX;) {
                          i = i + 1;
                        }
                        return 2;
                      }),
            -SIGXCPU);
}

TEST_F(SandboxTest, ComesTooLateForAProcessWithThreads) {
#ifdef FOVEA_SANITIZED
  GTEST_SKIP() << "sanitizers have threads of their own";
#endif
  const pid_t child = ::fork();
  if (child == 0) {
    std::thread waiter([] { ::pause(); });
    ::_exit(absl::IsFailedPrecondition(Confine({}).status()) ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST_F(SandboxTest, SaysWhatIsInForce) {
  const pid_t child = ::fork();
  if (child == 0) {
    const auto confinement = Confine(std::vector<std::string>{inside_});
    bool as_offered = confinement.ok() && confinement->landlock_abi == kernel_.landlock_abi;
#ifndef FOVEA_SANITIZED
    as_offered = as_offered && confinement->system_calls_filtered == kernel_.system_calls_filtered;
#endif
    ::_exit(as_offered ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace fovea::ingest
