#ifndef ENGINE_STORE_FILE_H_
#define ENGINE_STORE_FILE_H_

#include <cstddef>
#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file_system.h"

/// Every touch of files by the store, through the FileSystem that is given. Codes by cause:
/// NOT_FOUND, ALREADY_EXISTS, RESOURCE_EXHAUSTED (disk, quota, file size limit or descriptors used
/// up), DATA_LOSS (the device reports an error, or a file is shorter or longer than it can be),
/// FAILED_PRECONDITION (no permission, not a directory ...). Messages name the path.
namespace fovea::store {

[[nodiscard]] Status ErrnoStatus(int error, std::string_view action, const std::string& path);

/// Owns an open file.
class Handle {
 public:
  Handle() = default;
  /// What FileSystem::Open returned; nothing is owned if that was an error.
  Handle(FileSystem& files, int opened) : files_(&files), opened_(opened) {}
  Handle(Handle&& other) noexcept
      : files_(other.files_), opened_(std::exchange(other.opened_, -1)) {}
  Handle& operator=(Handle&& other) noexcept;
  ~Handle();
  [[nodiscard]] FileSystem& files() const { return *files_; }
  [[nodiscard]] bool ok() const { return opened_ >= 0; }
  /// -errno if it could not be opened.
  [[nodiscard]] int get() const { return opened_; }

 private:
  FileSystem* files_ = nullptr;
  int opened_ = -1;
};

/// A file open for positioned reads. Thread-safe.
class ReadableFile {
 public:
  [[nodiscard]] static StatusOr<ReadableFile> Open(FileSystem& files, const std::string& path);
  [[nodiscard]] int64_t size() const { return size_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  /// Fills `out` from `offset`; DATA_LOSS if the file ends before.
  [[nodiscard]] Status ReadAt(int64_t offset, std::span<std::byte> out) const;
  /// All of it; DATA_LOSS, without reading it, if it is longer than `max_bytes`.
  [[nodiscard]] StatusOr<std::vector<std::byte>> ReadWhole(int64_t max_bytes) const;
  /// Begins to read what ReadAt will be asked for, so that several reads wait together.
  void StartRead(int64_t offset, int64_t bytes) const {
    handle_.files().StartRead(handle_.get(), offset, bytes);
  }

 private:
  std::string path_;
  Handle handle_;
  int64_t size_ = 0;
};

/// Opens a file and ReadableFile::ReadWhole.
[[nodiscard]] StatusOr<std::vector<std::byte>> ReadWholeFile(FileSystem& files,
                                                             const std::string& path,
                                                             int64_t max_bytes);

/// A file being written from its start. Not flushed to the device: see FileBatch.
class WritableFile {
 public:
  /// Creates or truncates.
  [[nodiscard]] static StatusOr<WritableFile> Create(FileSystem& files, const std::string& path);
  /// Opens the file again if it was closed.
  [[nodiscard]] Status Append(std::span<const std::byte> bytes);
  void Close() { handle_ = Handle(); }
  [[nodiscard]] uint64_t size() const { return size_; }

 private:
  FileSystem* files_ = nullptr;
  std::string path_;
  Handle handle_;
  uint64_t size_ = 0;
};

/// The temporary name beside `path` under which a file is written before it appears.
[[nodiscard]] std::string TemporaryName(const std::string& path);
/// Whether a file name (without folder) is one of those.
[[nodiscard]] bool IsTemporaryName(std::string_view name);

/// `path` without slashes at its end; INVALID_ARGUMENT if nothing is left.
[[nodiscard]] StatusOr<std::string> StorePath(const std::string& path);
/// The folder that `path` is in.
[[nodiscard]] std::string DirectoryOf(const std::string& path);

/// Flushes a directory, so that names made or replaced in it survive a power cut.
[[nodiscard]] Status FlushDirectory(FileSystem& files, const std::string& path);
[[nodiscard]] Status MakeDirectory(FileSystem& files, const std::string& path);
[[nodiscard]] Status RemoveFile(FileSystem& files, const std::string& path);
/// Names in a directory, without "." and "..", in no order.
[[nodiscard]] StatusOr<std::vector<std::string>> ListDirectory(FileSystem& files,
                                                               const std::string& path);
/// Removes all that is in a directory, and then the directory.
[[nodiscard]] Status RemoveTree(FileSystem& files, const std::string& path);

/// Files that appear together. They are written under temporary names; Flush brings all of them
/// to the device, so that a full disk is known before anything has changed; Publish renames them.
/// What was not published is removed with the batch. Not thread-safe.
class FileBatch {
 public:
  explicit FileBatch(FileSystem& files) : files_(files) {}
  FileBatch(const FileBatch&) = delete;
  FileBatch& operator=(const FileBatch&) = delete;
  ~FileBatch() { Discard(); }

  /// Adds `path` and opens its temporary file.
  [[nodiscard]] StatusOr<WritableFile> Start(const std::string& path);
  [[nodiscard]] Status Write(const std::string& path, std::span<const std::byte> bytes);
  /// Takes the files of another batch over, behind its own.
  void Absorb(FileBatch* other);
  /// The files so far have no order among themselves, but are renamed before all that follow.
  void EndUnordered() { unordered_ = paths_.size(); }
  [[nodiscard]] Status Flush();
  /// Renames in the order of adding. The last file is the commit: it is renamed once the
  /// directories of all others are flushed, and then its own is.
  [[nodiscard]] Status Publish();
  void Discard();
  /// Nothing waits to be published.
  [[nodiscard]] bool empty() const { return paths_.empty(); }

 private:
  FileSystem& files_;
  /// Renames many unordered files with all threads.
  [[nodiscard]] Status PublishUnordered(std::set<std::string>* directories);

  std::vector<std::string> paths_;  // final names, not yet published
  size_t unordered_ = 0;            // the first of them that have no order
};

/// The right to write to a store: a lock on a file in it that says host, process and since when.
/// Goes with the process, however that ends.
class WriterLock {
 public:
  /// FAILED_PRECONDITION, saying who, if another writer holds it.
  [[nodiscard]] static StatusOr<WriterLock> Take(FileSystem& files, const std::string& store_path);
  WriterLock(WriterLock&&) = default;
  WriterLock& operator=(WriterLock&&) = delete;
  ~WriterLock();

 private:
  explicit WriterLock(Handle handle) : handle_(std::move(handle)) {}
  Handle handle_;
};

/// The name of the lock file inside a store.
inline constexpr std::string_view kLockName = ".fovea.lock";

}  // namespace fovea::store

#endif  // ENGINE_STORE_FILE_H_
