#ifndef ENGINE_STORE_FILE_SYSTEM_H_
#define ENGINE_STORE_FILE_SYSTEM_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace fovea::store {

/// A name in a directory.
struct DirectoryEntry {
  std::string name;
  bool is_directory = false;  // a link to one is none
};

/// The calls of the operating system that the store makes, one function each, so that a test can
/// put a disk of its own in their place (tests/support/simulated_disk.h). They mean what POSIX
/// says: what is returned is 0 or more, or -errno; reads and writes may be short; what was not
/// flushed may be lost when the machine stops, files and names apart. Everything above them is in
/// file.h. Thread-safe, but for one handle written by two threads.
class FileSystem {
 public:
  enum class Access {
    kRead,       // a file, to read or flush. Does not wait for pipes
    kCreate,     // a file, to write from its start: made, or emptied. Follows no link
    kAppend,     // a file that is there, to write on from its end. Follows no link
    kLock,       // a file, to lock and write: made if it is not there. Follows no link
    kDirectory,  // a directory, to flush
  };

  virtual ~FileSystem() = default;

  /// A handle, to be given back with Close.
  [[nodiscard]] virtual int Open(const std::string& path, Access access) = 0;
  virtual void Close(int handle) = 0;
  /// The bytes of a file; -EINVAL if it is no regular file.
  [[nodiscard]] virtual int64_t Size(int handle) = 0;
  /// How many bytes were read; 0 only at the end of the file.
  [[nodiscard]] virtual int64_t ReadAt(int handle, int64_t offset, std::span<std::byte> out) = 0;
  /// Begins to read a part of a file from the device. Promises nothing.
  virtual void StartRead(int /*handle*/, int64_t /*offset*/, int64_t /*bytes*/) {}
  /// Writes where the last write ended (kAppend: the first at the end of the file). How many bytes
  /// were written.
  [[nodiscard]] virtual int64_t Write(int handle, std::span<const std::byte> bytes) = 0;
  /// Makes a file open to be locked 0 bytes long.
  [[nodiscard]] virtual int Empty(int handle) = 0;
  /// Begins to write a file to the device. Promises nothing.
  virtual void StartFlush(int handle) = 0;
  /// A file's bytes, or a directory's names, are on the device.
  [[nodiscard]] virtual int Flush(int handle) = 0;
  /// Alone, until the handle is closed; -EWOULDBLOCK if another one holds it.
  [[nodiscard]] virtual int Lock(int handle) = 0;

  /// Replaces `to`, at once.
  [[nodiscard]] virtual int Rename(const std::string& from, const std::string& to) = 0;
  /// Another name for the file at `from`: a hard link. -EEXIST if `to` is there.
  [[nodiscard]] virtual int Link(const std::string& from, const std::string& to) = 0;
  [[nodiscard]] virtual int Remove(const std::string& path) = 0;
  [[nodiscard]] virtual int MakeDirectory(const std::string& path) = 0;
  /// It must be empty.
  [[nodiscard]] virtual int RemoveDirectory(const std::string& path) = 0;
  /// Appends what is in a directory, without "." and "..", in no order.
  [[nodiscard]] virtual int List(const std::string& path, std::vector<DirectoryEntry>* entries) = 0;

  /// The same files, for whoever makes many in few directories: these are found once, and stay
  /// open. If one gets another name meanwhile, it is the one that was found that is meant. Null:
  /// there is nothing better than this.
  [[nodiscard]] virtual std::unique_ptr<FileSystem> WithOpenDirectories() { return nullptr; }
};

/// The machine's own. It has no state.
[[nodiscard]] FileSystem& RealFileSystem();

}  // namespace fovea::store

#endif  // ENGINE_STORE_FILE_SYSTEM_H_
