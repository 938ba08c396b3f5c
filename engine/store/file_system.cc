#include "engine/store/file_system.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string_view>

#include <dirent.h>

namespace fovea::store {
namespace {

/// Calls until no signal is in the way.
template <typename Call>
auto Retrying(const Call& call) {
  auto result = call();
  while (result < 0 && errno == EINTR) {
    result = call();
  }
  return result < 0 ? static_cast<decltype(result)>(-errno) : result;
}

int FlagsOf(FileSystem::Access access) {
  switch (access) {
    case FileSystem::Access::kRead:
      return O_RDONLY | O_NONBLOCK;
    case FileSystem::Access::kCreate:
      return O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW;
    case FileSystem::Access::kAppend:
      return O_WRONLY | O_APPEND | O_NOFOLLOW;
    case FileSystem::Access::kLock:
      return O_RDWR | O_CREAT | O_NOFOLLOW;
    case FileSystem::Access::kDirectory:
      break;
  }
  return O_RDONLY | O_DIRECTORY;
}

bool IsDirectory(const std::string& path, const dirent& entry) {
  if (entry.d_type != DT_UNKNOWN) {
    return entry.d_type == DT_DIR;
  }
  struct stat info {};
  return ::lstat((path + "/" + entry.d_name).c_str(), &info) == 0 && S_ISDIR(info.st_mode);
}

/// A name in an open directory, or a path.
struct Place {
  int directory = AT_FDCWD;
  const char* name = nullptr;
};

class PosixFileSystem : public FileSystem {
 public:
  [[nodiscard]] int Open(const std::string& path, Access access) override {
    const Place at = Find(path);
    return Retrying(
        [&] { return ::openat(at.directory, at.name, FlagsOf(access) | O_CLOEXEC, 0666); });
  }
  void Close(int handle) override { ::close(handle); }
  [[nodiscard]] int64_t Size(int handle) override {
    struct stat info {};
    if (::fstat(handle, &info) != 0) {
      return -errno;
    }
    return S_ISREG(info.st_mode) ? static_cast<int64_t>(info.st_size) : -EINVAL;
  }
  [[nodiscard]] int64_t ReadAt(int handle, int64_t offset, std::span<std::byte> out) override {
    return Retrying([&] { return ::pread(handle, out.data(), out.size(), offset); });
  }
  void StartRead(int handle, int64_t offset, int64_t bytes) override {
    [[maybe_unused]] const int hint = ::posix_fadvise(handle, offset, bytes, POSIX_FADV_WILLNEED);
  }
  [[nodiscard]] int64_t Write(int handle, std::span<const std::byte> bytes) override {
    return Retrying([&] { return ::write(handle, bytes.data(), bytes.size()); });
  }
  [[nodiscard]] int Empty(int handle) override {
    return Retrying([&] { return ::ftruncate(handle, 0); });
  }
  void StartFlush(int handle) override {
    [[maybe_unused]] const int hint = ::sync_file_range(handle, 0, 0, SYNC_FILE_RANGE_WRITE);
  }
  [[nodiscard]] int Flush(int handle) override { return ::fsync(handle) == 0 ? 0 : -errno; }
  [[nodiscard]] int Lock(int handle) override {
    return Retrying([&] { return ::flock(handle, LOCK_EX | LOCK_NB); });
  }
  [[nodiscard]] int Rename(const std::string& from, const std::string& to) override {
    const Place old = Find(from), now = Find(to);
    return ::renameat(old.directory, old.name, now.directory, now.name) == 0 ? 0 : -errno;
  }
  [[nodiscard]] int Link(const std::string& from, const std::string& to) override {
    return ::link(from.c_str(), to.c_str()) == 0 ? 0 : -errno;
  }
  [[nodiscard]] int Remove(const std::string& path) override {
    const Place at = Find(path);
    return ::unlinkat(at.directory, at.name, 0) == 0 ? 0 : -errno;
  }
  [[nodiscard]] int MakeDirectory(const std::string& path) override {
    return ::mkdir(path.c_str(), 0777) == 0 ? 0 : -errno;
  }
  [[nodiscard]] int RemoveDirectory(const std::string& path) override {
    return ::rmdir(path.c_str()) == 0 ? 0 : -errno;
  }
  [[nodiscard]] int List(const std::string& path, std::vector<DirectoryEntry>* entries) override {
    const std::unique_ptr<DIR, int (*)(DIR*)> directory(::opendir(path.c_str()), ::closedir);
    if (directory == nullptr) {
      return -errno;
    }
    errno = 0;
    // readdir is safe here: the DIR is ours alone.
    while (const dirent* entry = ::readdir(directory.get())) {  // NOLINT(concurrency-mt-unsafe)
      const std::string_view name = entry->d_name;
      if (name != "." && name != "..") {
        entries->push_back({std::string(name), IsDirectory(path, *entry)});
      }
      errno = 0;
    }
    return -errno;
  }
  [[nodiscard]] std::unique_ptr<FileSystem> WithOpenDirectories() override;

 protected:
  /// Valid as long as `path`.
  virtual Place Find(const std::string& path) { return {AT_FDCWD, path.c_str()}; }
};

/// Directories are opened when a file in them is first asked for.
class OpenDirectories final : public PosixFileSystem {
 public:
  OpenDirectories() = default;
  OpenDirectories(const OpenDirectories&) = delete;
  OpenDirectories& operator=(const OpenDirectories&) = delete;
  ~OpenDirectories() override {
    for (const auto& [path, handle] : open_) {
      ::close(handle);
    }
  }

 protected:
  Place Find(const std::string& path) override {
    const size_t slash = path.rfind('/');
    if (slash == std::string::npos || slash == 0) {
      return PosixFileSystem::Find(path);
    }
    const std::lock_guard lock(mutex_);
    auto found = open_.find(std::string_view(path).substr(0, slash));
    if (found == open_.end()) {
      if (open_.size() == kMost) {
        return PosixFileSystem::Find(path);
      }
      const std::string directory = path.substr(0, slash);
      const int handle = ::open(directory.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
      if (handle < 0) {
        return PosixFileSystem::Find(path);
      }
      found = open_.emplace(directory, handle).first;
    }
    return {found->second, path.c_str() + slash + 1};
  }

 private:
  static constexpr size_t kMost = 64;  // descriptors are few
  std::mutex mutex_;
  std::map<std::string, int, std::less<>> open_;  // guarded by mutex_
};

std::unique_ptr<FileSystem> PosixFileSystem::WithOpenDirectories() {
  return std::make_unique<OpenDirectories>();
}

}  // namespace

FileSystem& RealFileSystem() {
  static PosixFileSystem real;
  return real;
}

}  // namespace fovea::store
