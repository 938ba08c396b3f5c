#include "engine/store/file.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <ctime>
#include <iterator>
#include <system_error>
#include <utility>

#include "engine/base/parallel.h"

namespace fovea::store {
namespace {

constexpr std::string_view kTemporarySuffix = ".tmp";
/// That flush or rename the files of a batch: more would wait for each other, and hold handles.
constexpr int kMostThreads = 4;

using Access = FileSystem::Access;

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

Handle& Handle::operator=(Handle&& other) noexcept {
  std::swap(files_, other.files_);
  std::swap(opened_, other.opened_);
  return *this;
}

Handle::~Handle() {
  if (opened_ >= 0) {
    files_->Close(opened_);
  }
}

StatusOr<ReadableFile> ReadableFile::Open(FileSystem& files, const std::string& path) {
  ReadableFile file;
  file.path_ = path;
  file.handle_ = Handle(files, files.Open(path, Access::kRead));
  if (!file.handle_.ok()) {
    return ErrnoStatus(-file.handle_.get(), "cannot open", path);
  }
  file.size_ = files.Size(file.handle_.get());
  if (file.size_ == -EINVAL) {
    return FailedPrecondition("cannot read {}: not a regular file", path);
  }
  if (file.size_ < 0) {
    return ErrnoStatus(static_cast<int>(-file.size_), "cannot open", path);
  }
  return file;
}

Status ReadableFile::ReadAt(int64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const int64_t got = handle_.files().ReadAt(handle_.get(), offset, out);
    if (got < 0) {
      return ErrnoStatus(static_cast<int>(-got), "cannot read", path_);
    }
    if (got == 0) {
      return DataLoss("{} ends {} bytes too early", path_, out.size());
    }
    offset += got;
    out = out.subspan(static_cast<size_t>(got));
  }
  return absl::OkStatus();
}

StatusOr<std::vector<std::byte>> ReadableFile::ReadWhole(int64_t max_bytes) const {
  if (size_ > max_bytes) {
    return DataLoss("{} has {} bytes, at most {} can be right", path_, size_, max_bytes);
  }
  std::vector<std::byte> bytes(static_cast<size_t>(size_));
  FOVEA_RETURN_IF_ERROR(ReadAt(0, bytes));
  return bytes;
}

StatusOr<std::vector<std::byte>> ReadWholeFile(FileSystem& files, const std::string& path,
                                               int64_t max_bytes) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile file, ReadableFile::Open(files, path));
  return file.ReadWhole(max_bytes);
}

StatusOr<WritableFile> WritableFile::Create(FileSystem& files, const std::string& path) {
  WritableFile file;
  file.files_ = &files;
  file.path_ = path;
  file.handle_ = Handle(files, files.Open(path, Access::kCreate));
  if (!file.handle_.ok()) {
    return ErrnoStatus(-file.handle_.get(), "cannot create", path);
  }
  return file;
}

Status WritableFile::Append(std::span<const std::byte> bytes) {
  if (!handle_.ok()) {
    handle_ = Handle(*files_, files_->Open(path_, Access::kAppend));
    if (!handle_.ok()) {
      return ErrnoStatus(-handle_.get(), "cannot open", path_);
    }
  }
  while (!bytes.empty()) {
    const int64_t put = handle_.files().Write(handle_.get(), bytes);
    if (put < 0) {
      return ErrnoStatus(static_cast<int>(-put), "cannot write", path_);
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

Status FlushDirectory(FileSystem& files, const std::string& path) {
  const Handle handle(files, files.Open(path, Access::kDirectory));
  if (!handle.ok()) {
    return ErrnoStatus(-handle.get(), "cannot open", path);
  }
  const int flushed = files.Flush(handle.get());
  return flushed < 0 ? ErrnoStatus(-flushed, "cannot flush", path) : absl::OkStatus();
}

Status MakeDirectory(FileSystem& files, const std::string& path) {
  const int made = files.MakeDirectory(path);
  return made < 0 ? ErrnoStatus(-made, "cannot make directory", path) : absl::OkStatus();
}

Status RemoveFile(FileSystem& files, const std::string& path) {
  const int removed = files.Remove(path);
  return removed < 0 ? ErrnoStatus(-removed, "cannot remove", path) : absl::OkStatus();
}

StatusOr<std::vector<std::string>> ListDirectory(FileSystem& files, const std::string& path) {
  std::vector<DirectoryEntry> entries;
  if (const int listed = files.List(path, &entries); listed < 0) {
    return ErrnoStatus(-listed, "cannot list", path);
  }
  std::vector<std::string> names;
  names.reserve(entries.size());
  for (DirectoryEntry& entry : entries) {
    names.push_back(std::move(entry.name));
  }
  return names;
}

Status RemoveTree(FileSystem& files, const std::string& path) {
  std::vector<DirectoryEntry> entries;
  if (const int listed = files.List(path, &entries); listed < 0) {
    return ErrnoStatus(-listed, "cannot list", path);
  }
  for (const DirectoryEntry& entry : entries) {
    const std::string inside = fmt::format("{}/{}", path, entry.name);
    FOVEA_RETURN_IF_ERROR(entry.is_directory ? RemoveTree(files, inside)
                                             : RemoveFile(files, inside));
  }
  const int removed = files.RemoveDirectory(path);
  return removed < 0 ? ErrnoStatus(-removed, "cannot remove", path) : absl::OkStatus();
}

namespace {

Status FlushTemporaries(FileSystem& files, std::span<const std::string> paths) {
  std::vector<Handle> handles;
  for (const std::string& path : paths) {
    const std::string name = TemporaryName(path);
    handles.emplace_back(files, files.Open(name, Access::kRead));
    if (!handles.back().ok()) {
      return ErrnoStatus(-handles.back().get(), "cannot open", name);
    }
    files.StartFlush(handles.back().get());
  }
  for (size_t i = 0; i < paths.size(); ++i) {
    if (const int flushed = files.Flush(handles[i].get()); flushed < 0) {
      return ErrnoStatus(-flushed, "cannot flush", TemporaryName(paths[i]));
    }
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<WritableFile> FileBatch::Start(const std::string& path) {
  paths_.push_back(path);
  return WritableFile::Create(files_, TemporaryName(path));
}

Status FileBatch::Write(const std::string& path, std::span<const std::byte> bytes) {
  FOVEA_ASSIGN_OR_RETURN(WritableFile file, Start(path));
  return file.Append(bytes);
}

void FileBatch::Absorb(FileBatch* other) {
  paths_.insert(paths_.end(), std::make_move_iterator(other->paths_.begin()),
                std::make_move_iterator(other->paths_.end()));
  other->paths_.clear();
}

Status FileBatch::Flush() {
  // Writing is started for many first: the file system then commits most of them with the first
  // flush, and the others cost little.
  constexpr int64_t kAtOnce = 64;  // handles of a thread
  const int64_t groups = (std::ssize(paths_) + kAtOnce - 1) / kAtOnce;
  std::vector<Status> results(static_cast<size_t>(groups));
  ParallelFor(0, std::ssize(paths_), kAtOnce, kMostThreads, [&](int64_t first, int64_t last) {
    const auto begin = static_cast<size_t>(first), count = static_cast<size_t>(last - first);
    results[static_cast<size_t>(first / kAtOnce)] =
        FlushTemporaries(files_, std::span(paths_).subspan(begin, count));
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return absl::OkStatus();
}

Status FileBatch::PublishUnordered(std::set<std::string>* directories) {
  constexpr int64_t kAtOnce = 64;
  const auto count = static_cast<int64_t>(std::exchange(unordered_, 0));
  if (count <= kAtOnce) {
    return absl::OkStatus();  // in turn, with the others
  }
  std::vector<Status> results(static_cast<size_t>((count + kAtOnce - 1) / kAtOnce));
  ParallelFor(0, count, kAtOnce, kMostThreads, [&](int64_t first, int64_t last) {
    Status& result = results[static_cast<size_t>(first / kAtOnce)];
    for (int64_t i = first; result.ok() && i < last; ++i) {
      const std::string& path = paths_[static_cast<size_t>(i)];
      if (const int renamed = files_.Rename(TemporaryName(path), path); renamed < 0) {
        result = ErrnoStatus(-renamed, "cannot rename to", path);
      }
    }
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  const auto end = paths_.begin() + count;
  std::for_each(paths_.begin(), end,
                [&](const std::string& path) { directories->insert(DirectoryOf(path)); });
  paths_.erase(paths_.begin(), end);
  return absl::OkStatus();
}

Status FileBatch::Publish() {
  std::set<std::string> directories;
  FOVEA_RETURN_IF_ERROR(PublishUnordered(&directories));
  std::reverse(paths_.begin(), paths_.end());  // published ones leave at the end
  while (!paths_.empty()) {
    const std::string path = paths_.back();
    if (paths_.size() == 1) {
      for (const std::string& directory : directories) {
        FOVEA_RETURN_IF_ERROR(FlushDirectory(files_, directory));
      }
      directories.clear();
    }
    if (const int renamed = files_.Rename(TemporaryName(path), path); renamed < 0) {
      return ErrnoStatus(-renamed, "cannot rename to", path);
    }
    directories.insert(DirectoryOf(path));
    paths_.pop_back();
  }
  for (const std::string& directory : directories) {
    FOVEA_RETURN_IF_ERROR(FlushDirectory(files_, directory));
  }
  return absl::OkStatus();
}

void FileBatch::Discard() {
  for (const std::string& path : paths_) {
    // Gone already, or it stays: the next writer removes it.
    [[maybe_unused]] const int removed = files_.Remove(TemporaryName(path));
  }
  paths_.clear();
  unordered_ = 0;
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
std::string ReadHolder(const Handle& handle) {
  std::string holder(256, '\0');
  const int64_t size =
      handle.files().ReadAt(handle.get(), 0, std::as_writable_bytes(std::span(holder)));
  holder.resize(static_cast<size_t>(std::max<int64_t>(size, 0)));
  holder.erase(std::find(holder.begin(), holder.end(), '\n'), holder.end());
  std::replace_if(
      holder.begin(), holder.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return holder.empty() ? "another process" : holder;
}

}  // namespace

StatusOr<WriterLock> WriterLock::Take(FileSystem& files, const std::string& store_path) {
  const std::string path = fmt::format("{}/{}", store_path, kLockName);
  Handle handle(files, files.Open(path, Access::kLock));
  if (!handle.ok()) {
    return ErrnoStatus(-handle.get(), "cannot open the lock file", path);
  }
  if (const int locked = files.Lock(handle.get()); locked < 0) {
    if (locked != -EWOULDBLOCK) {
      return ErrnoStatus(-locked, "cannot lock", path);
    }
    return FailedPrecondition("{} is being written by {}; wait until it is done, or stop it",
                              store_path, ReadHolder(handle));
  }
  const std::string text = HolderText() + "\n";
  // Only for people to read: a full disk must not keep a store from being opened.
  if (files.Empty(handle.get()) == 0) {
    [[maybe_unused]] const int64_t put = files.Write(handle.get(), std::as_bytes(std::span(text)));
  }
  return WriterLock(std::move(handle));
}

WriterLock::~WriterLock() {
  if (handle_.ok()) {
    [[maybe_unused]] const int emptied = handle_.files().Empty(handle_.get());
  }
}

}  // namespace fovea::store
