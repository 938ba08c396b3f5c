#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

#include "engine/base/status.h"
#include "engine/base/stopwatch.h"
#include "service/cli/console.h"
#include "service/cli/doctor_checks.h"

namespace fovea::cli {
namespace {

constexpr uint64_t kComfortableFreeBytes = uint64_t{1} << 30;

/// "ext4 on /dev/sda1", from the line of /proc/self/mountinfo (proc(5)) with the folder's device.
std::string FileSystemOf(const std::string& folder) {
  struct stat about {};
  if (::stat(folder.c_str(), &about) != 0) {
    return "";
  }
  const std::string device = fmt::format("{}:{}", major(about.st_dev), minor(about.st_dev));
  std::ifstream mounts("/proc/self/mountinfo");
  for (std::string line; std::getline(mounts, line);) {
    std::istringstream words(line);
    std::string word, number;
    words >> word >> word >> number;
    const size_t dash = line.find(" - ");
    if (number != device || dash == std::string::npos) {
      continue;
    }
    std::istringstream rest(line.substr(dash + 3));
    std::string type, source;
    rest >> type >> source;
    return type + " on " + source;
  }
  return "unknown";
}

/// Two files in the folder that go with the object.
class Probe {
 public:
  explicit Probe(const std::string& folder)
      : first_(fmt::format("{}/.fovea-doctor.{}.a", folder, ::getpid())),
        second_(fmt::format("{}/.fovea-doctor.{}.b", folder, ::getpid())),
        folder_(folder) {}
  ~Probe() {
    ::unlink(first_.c_str());
    ::unlink(second_.c_str());
  }
  Probe(const Probe&) = delete;
  Probe& operator=(const Probe&) = delete;

  /// errno, or 0.
  [[nodiscard]] int Write() const { return WriteFile(first_, "first"); }
  [[nodiscard]] int Sync() const;
  [[nodiscard]] int RenameOver() const;
  [[nodiscard]] int Lock() const;

 private:
  static int WriteFile(const std::string& path, const std::string& text) {
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file < 0) {
      return errno;
    }
    const bool done = ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
    const int error = done ? 0 : errno == 0 ? EIO : errno;
    ::close(file);
    return error;
  }

  std::string first_, second_, folder_;
};

int Probe::Sync() const {
  for (const std::string& path : {first_, folder_}) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    const int error = file < 0 || ::fsync(file) != 0 ? errno : 0;
    if (file >= 0) {
      ::close(file);
    }
    if (error != 0) {
      return error;
    }
  }
  return 0;
}

int Probe::RenameOver() const {
  if (const int error = WriteFile(second_, "second"); error != 0) {
    return error;
  }
  return ::rename(second_.c_str(), first_.c_str()) == 0 ? 0 : errno;
}

/// Whether a lock that one holds is refused to another.
int Probe::Lock() const {
  const int one = ::open(first_.c_str(), O_RDWR | O_CLOEXEC);
  const int other = ::open(first_.c_str(), O_RDWR | O_CLOEXEC);
  int error = 0;
  if (one < 0 || other < 0 || ::flock(one, LOCK_EX | LOCK_NB) != 0) {
    error = errno;
  } else if (::flock(other, LOCK_EX | LOCK_NB) == 0) {
    error = ENOLCK;
  }
  for (const int file : {one, other}) {
    if (file >= 0) {
      ::close(file);
    }
  }
  return error;
}

Finding Outcome(const char* about, int error, std::string good, const char* advice) {
  if (error == 0) {
    return {about, std::move(good), Verdict::kGood, ""};
  }
  return {about, std::strerror(error), Verdict::kMissing, advice};
}

Finding CheckSpace(const std::string& folder) {
  struct statvfs about {};
  if (::statvfs(folder.c_str(), &about) != 0) {
    return {"free space", std::strerror(errno), Verdict::kLacking, ""};
  }
  const uint64_t bytes = uint64_t{about.f_bavail} * about.f_frsize;
  const bool lacks_names = about.f_files > 0 && about.f_favail < 100'000;
  Finding finding{"free space", HumanBytes(bytes), Verdict::kGood, ""};
  if (bytes < kComfortableFreeBytes || lacks_names) {
    finding.verdict = Verdict::kLacking;
    finding.found += lacks_names ? fmt::format(", {} more files", about.f_favail) : "";
    finding.advice =
        "a step of 256 x 256 x 256 voxels takes up to 64 MiB; free some, or write "
        "elsewhere";
  }
  return finding;
}

}  // namespace

std::vector<Finding> CheckFolder(const std::string& folder, bool must_be_writable) {
  struct stat about {};
  if (::stat(folder.c_str(), &about) != 0 || !S_ISDIR(about.st_mode)) {
    return {{"folder", fmt::format("'{}' is not there, or no folder", folder), Verdict::kMissing,
             "name one that is"}};
  }
  const Probe probe(folder);
  const int error = probe.Write();
  Finding writing{"folder", fmt::format("'{}': {}", folder, FileSystemOf(folder)), Verdict::kGood,
                  ""};
  if (error != 0) {
    writing.found += fmt::format(", cannot be written to: {}", std::strerror(error));
    writing.verdict = must_be_writable ? Verdict::kMissing : Verdict::kLacking;
    writing.advice = "stores can be read there, but not made";
    return {writing};
  }
  const Stopwatch watch;
  const int sync_error = probe.Sync();
  const double sync_ms = watch.ElapsedMs();
  return {
      writing, CheckSpace(folder),
      Outcome("syncing", sync_error, fmt::format("{:.1f} ms for a file and its folder", sync_ms),
              "a step that was committed may be lost when the machine stops: use another file "
              "system"),
      Outcome("renaming", probe.RenameOver(), "over a file that is there",
              "stores cannot be committed there: use another file system"),
      Outcome("locking", probe.Lock(), "keeps a second writer out",
              "two writers would damage a store: see that only one writes, or use another "
              "file system")};
}

}  // namespace fovea::cli
