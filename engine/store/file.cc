#include "engine/store/file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <ctime>
#include <memory>
#include <set>
#include <system_error>

#include <dirent.h>

namespace fovea::store {
namespace {

constexpr std::string_view kTemporarySuffix = ".tmp";

int OpenRetrying(const std::string& path, int flags, mode_t mode = 0) {
  int fd = -1;
  do {
    fd = ::open(path.c_str(), flags | O_CLOEXEC, mode);
  } while (fd < 0 && errno == EINTR);
  return fd;
}

/// fsync through a descriptor of its own; a write error that nobody was told of yet comes here.
Status FlushPath(const std::string& path, int flags) {
  const Descriptor fd(OpenRetrying(path, flags));
  if (fd.get() < 0) {
    return ErrnoStatus(errno, "cannot open", path);
  }
  if (::fsync(fd.get()) != 0) {
    return ErrnoStatus(errno, "cannot flush", path);
  }
  return absl::OkStatus();
}

}  // namespace

Status ErrnoStatus(int error, std::string_view action, const std::string& path) {
  const std::string message =
      fmt::format("{} {}: {}", action, path, std::generic_category().message(error));
  switch (error) {
    case ENOENT:
      return NotFound("{}", message);
    case EEXIST:
      return AlreadyExists("{}", message);
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
      return ResourceExhausted("{}; free some space or write elsewhere", message);
    case EMFILE:
    case ENFILE:
    case ENOMEM:
      return ResourceExhausted("{}", message);
    case EIO:
      return DataLoss("{}", message);
    default:
      return FailedPrecondition("{}", message);
  }
}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

Descriptor::~Descriptor() {
  if (fd_ >= 0) {
    ::close(fd_);
  }
}

StatusOr<ReadableFile> ReadableFile::Open(const std::string& path) {
  ReadableFile file;
  file.path_ = path;
  // O_NONBLOCK: a pipe put in a file's place must not hang the reader.
  file.fd_ = Descriptor(OpenRetrying(path, O_RDONLY | O_NONBLOCK));
  struct stat info {};
  if (file.fd_.get() < 0 || ::fstat(file.fd_.get(), &info) != 0) {
    return ErrnoStatus(errno, "cannot open", path);
  }
  if (!S_ISREG(info.st_mode)) {
    return FailedPrecondition("cannot read {}: not a regular file", path);
  }
  file.size_ = info.st_size;
  return file;
}

Status ReadableFile::ReadAt(int64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const ssize_t got = ::pread(fd_.get(), out.data(), out.size(), offset);
    if (got < 0 && errno == EINTR) {
      continue;
    }
    if (got < 0) {
      return ErrnoStatus(errno, "cannot read", path_);
    }
    if (got == 0) {
      return DataLoss("{} ends {} bytes too early", path_, out.size());
    }
    offset += got;
    out = out.subspan(static_cast<size_t>(got));
  }
  return absl::OkStatus();
}

StatusOr<std::vector<std::byte>> ReadWholeFile(const std::string& path, int64_t max_bytes) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile file, ReadableFile::Open(path));
  if (file.size() > max_bytes) {
    return DataLoss("{} has {} bytes, at most {} can be right", path, file.size(), max_bytes);
  }
  std::vector<std::byte> bytes(static_cast<size_t>(file.size()));
  FOVEA_RETURN_IF_ERROR(file.ReadAt(0, bytes));
  return bytes;
}

StatusOr<WritableFile> WritableFile::Create(const std::string& path) {
  WritableFile file;
  file.path_ = path;
  file.fd_ = Descriptor(OpenRetrying(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW, 0666));
  if (file.fd_.get() < 0) {
    return ErrnoStatus(errno, "cannot create", path);
  }
  return file;
}

Status WritableFile::Append(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t put = ::write(fd_.get(), bytes.data(), bytes.size());
    if (put < 0 && errno == EINTR) {
      continue;
    }
    if (put < 0) {
      return ErrnoStatus(errno, "cannot write", path_);
    }
    size_ += static_cast<uint64_t>(put);
    bytes = bytes.subspan(static_cast<size_t>(put));
  }
  return absl::OkStatus();
}

std::string TemporaryName(const std::string& path) {
  const size_t slash = path.rfind('/');
  const size_t name = slash == std::string::npos ? 0 : slash + 1;
  return fmt::format("{}.{}{}", path.substr(0, name), path.substr(name), kTemporarySuffix);
}

bool IsTemporaryName(std::string_view name) {
  return name.starts_with('.') && name.ends_with(kTemporarySuffix);
}

StatusOr<std::string> StorePath(const std::string& path) {
  const size_t last = path.find_last_not_of('/');
  if (last == std::string::npos) {
    return InvalidArgument("'{}' cannot be the path of a store", path);
  }
  return path.substr(0, last + 1);
}

std::string DirectoryOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
}

Status FlushDirectory(const std::string& path) {
  return FlushPath(path, O_RDONLY | O_DIRECTORY);
}

Status MakeDirectory(const std::string& path) {
  if (::mkdir(path.c_str(), 0777) != 0) {
    return ErrnoStatus(errno, "cannot make directory", path);
  }
  return absl::OkStatus();
}

Status RemoveFile(const std::string& path) {
  if (::unlink(path.c_str()) != 0) {
    return ErrnoStatus(errno, "cannot remove", path);
  }
  return absl::OkStatus();
}

StatusOr<std::vector<std::string>> ListDirectory(const std::string& path) {
  const std::unique_ptr<DIR, int (*)(DIR*)> directory(::opendir(path.c_str()), ::closedir);
  if (directory == nullptr) {
    return ErrnoStatus(errno, "cannot list", path);
  }
  std::vector<std::string> names;
  errno = 0;
  // readdir is safe here: the DIR is ours alone.
  while (const dirent* entry = ::readdir(directory.get())) {  // NOLINT(concurrency-mt-unsafe)
    const std::string_view name = entry->d_name;
    if (name != "." && name != "..") {
      names.emplace_back(name);
    }
  }
  if (errno != 0) {
    return ErrnoStatus(errno, "cannot list", path);
  }
  return names;
}

StatusOr<WritableFile> FileBatch::Start(const std::string& path) {
  paths_.push_back(path);
  return WritableFile::Create(TemporaryName(path));
}

Status FileBatch::Write(const std::string& path, std::span<const std::byte> bytes) {
  FOVEA_ASSIGN_OR_RETURN(WritableFile file, Start(path));
  return file.Append(bytes);
}

Status FileBatch::Flush() {
  // Writing is started for all of them first: the file system then commits most of them with the
  // first flush, and the others cost little.
  for (const std::string& path : paths_) {
    const Descriptor fd(OpenRetrying(TemporaryName(path), O_RDONLY));
    [[maybe_unused]] const int hint = ::sync_file_range(fd.get(), 0, 0, SYNC_FILE_RANGE_WRITE);
  }
  for (const std::string& path : paths_) {
    FOVEA_RETURN_IF_ERROR(FlushPath(TemporaryName(path), O_RDONLY));
  }
  return absl::OkStatus();
}

Status FileBatch::Publish() {
  std::set<std::string> directories;
  std::reverse(paths_.begin(), paths_.end());  // published ones leave at the end
  while (!paths_.empty()) {
    const std::string path = paths_.back();
    if (paths_.size() == 1) {
      for (const std::string& directory : directories) {
        FOVEA_RETURN_IF_ERROR(FlushDirectory(directory));
      }
      directories.clear();
    }
    if (::rename(TemporaryName(path).c_str(), path.c_str()) != 0) {
      return ErrnoStatus(errno, "cannot rename to", path);
    }
    directories.insert(DirectoryOf(path));
    paths_.pop_back();
  }
  for (const std::string& directory : directories) {
    FOVEA_RETURN_IF_ERROR(FlushDirectory(directory));
  }
  return absl::OkStatus();
}

void FileBatch::Discard() {
  for (const std::string& path : paths_) {
    ::unlink(TemporaryName(path).c_str());
  }
  paths_.clear();
}

namespace {

std::string HolderText() {
  char host[256] = "unknown host";
  ::gethostname(host, sizeof(host) - 1);
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  char since[32] = "";
  std::strftime(since, sizeof(since), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return fmt::format("process {} on {} since {}", ::getpid(), host, since);
}

/// What the lock file says, printable whatever is in it.
std::string ReadHolder(int fd) {
  char text[256];
  const ssize_t size = ::pread(fd, text, sizeof(text), 0);
  std::string holder(text, static_cast<size_t>(std::max<ssize_t>(size, 0)));
  holder.erase(std::find(holder.begin(), holder.end(), '\n'), holder.end());
  std::replace_if(
      holder.begin(), holder.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return holder.empty() ? "another process" : holder;
}

}  // namespace

StatusOr<WriterLock> WriterLock::Take(const std::string& store_path) {
  const std::string path = fmt::format("{}/{}", store_path, kLockName);
  Descriptor fd(OpenRetrying(path, O_RDWR | O_CREAT | O_NOFOLLOW, 0666));
  if (fd.get() < 0) {
    return ErrnoStatus(errno, "cannot open the lock file", path);
  }
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) {
      return ErrnoStatus(errno, "cannot lock", path);
    }
    return FailedPrecondition("{} is being written by {}; wait until it is done, or stop it",
                              store_path, ReadHolder(fd.get()));
  }
  const std::string text = HolderText() + "\n";
  // Only for people to read: a full disk must not keep a store from being opened.
  if (::ftruncate(fd.get(), 0) == 0) {
    [[maybe_unused]] const ssize_t put = ::pwrite(fd.get(), text.data(), text.size(), 0);
  }
  return WriterLock(std::move(fd));
}

WriterLock::~WriterLock() {
  if (fd_.get() >= 0) {
    [[maybe_unused]] const int emptied = ::ftruncate(fd_.get(), 0);
  }
}

}  // namespace fovea::store
