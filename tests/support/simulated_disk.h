#ifndef TESTS_SUPPORT_SIMULATED_DISK_H_
#define TESTS_SUPPORT_SIMULATED_DISK_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/store/file_system.h"

namespace fovea::testing {

/// A disk in memory. It keeps only what was flushed: the bytes of a file when the file was, names
/// (made, replaced, removed) when their directory was; of the rest a power cut keeps any subset.
/// Calls can be made to fail, reads and writes to be short, handles to run out. Paths are from its
/// root, with or without '/' in front. No symbolic links, no permissions. Thread-safe, but for the
/// settings.
class SimulatedDisk final : public store::FileSystem {
 public:
  enum class Operation {
    kOpen,    // to read or flush a file or directory
    kCreate,  // to write or lock a file
    kSize,
    kRead,
    kWrite,
    kEmpty,
    kFlush,
    kFlushDirectory,
    kLock,
    kRename,
    kLink,
    kRemove,
    kMakeDirectory,
    kRemoveDirectory,
    kList,
  };
  struct Call {
    int64_t index = 0;  // 0, 1 ... since the disk was made
    Operation operation = Operation::kOpen;
    std::string path;  // of a rename or link: its target
  };
  /// Whether a call changes what is, or will be, on the disk.
  [[nodiscard]] static bool Changes(Operation operation);

  SimulatedDisk();

  /// Is asked at every call but Close, StartRead and StartFlush; what is not 0 is returned by the
  /// call (a -errno), and nothing is done.
  void set_fault(std::function<int(const Call&)> fault) { fault_ = std::move(fault); }
  /// Reads and writes do 1 to this many bytes at a time, in turns. 0: all that is asked.
  void set_most_at_once(size_t bytes) { most_at_once_ = bytes; }
  /// -EMFILE past so many open handles.
  void set_handle_limit(size_t handles) { handle_limit_ = handles; }
  [[nodiscard]] int64_t calls() const { return calls_; }
  /// How often StartRead was called; may be asked by a fault.
  [[nodiscard]] int64_t started_reads() const { return started_reads_; }
  [[nodiscard]] size_t open_handles() const { return handles_.size(); }
  /// The most that were open at a time.
  [[nodiscard]] size_t most_open_handles() const { return most_open_handles_; }

  /// What a power cut leaves of bytes that were written and not flushed.
  enum class Kept {
    kNone,   // what was there at the last flush
    kHalf,   // the first half of what came since
    kZeros,  // the length, and zeros
    kAll,
  };
  /// Names made, replaced or removed and not flushed, in order: each is kept or not.
  [[nodiscard]] size_t UnflushedNames() const { return unflushed_.size(); }
  /// The disk as it is found after a power cut now: change i of the names is there if
  /// keeps_name(i); what of the bytes of files is there says `kept`. No handle is open on it, and
  /// nothing fails.
  [[nodiscard]] std::unique_ptr<SimulatedDisk> AfterPowerCut(
      const std::function<bool(size_t)>& keeps_name, Kept kept) const;
  /// The disk as it is found when only the process died.
  [[nodiscard]] std::unique_ptr<SimulatedDisk> AfterKill() const;

  /// Every file, by path; directories are not in it.
  [[nodiscard]] std::map<std::string, std::vector<std::byte>> Files() const;

  [[nodiscard]] int Open(const std::string& path, Access access) override;
  void Close(int handle) override;
  [[nodiscard]] int64_t Size(int handle) override;
  [[nodiscard]] int64_t ReadAt(int handle, int64_t offset, std::span<std::byte> out) override;
  void StartRead(int /*handle*/, int64_t /*offset*/, int64_t /*bytes*/) override {
    ++started_reads_;
  }
  [[nodiscard]] int64_t Write(int handle, std::span<const std::byte> bytes) override;
  [[nodiscard]] int Empty(int handle) override;
  void StartFlush(int /*handle*/) override {}
  [[nodiscard]] int Flush(int handle) override;
  [[nodiscard]] int Lock(int handle) override;
  [[nodiscard]] int Rename(const std::string& from, const std::string& to) override;
  [[nodiscard]] int Link(const std::string& from, const std::string& to) override;
  [[nodiscard]] int Remove(const std::string& path) override;
  [[nodiscard]] int MakeDirectory(const std::string& path) override;
  [[nodiscard]] int RemoveDirectory(const std::string& path) override;
  [[nodiscard]] int List(const std::string& path,
                         std::vector<store::DirectoryEntry>* entries) override;

 private:
  using Names = std::map<std::string, size_t>;  // to nodes
  struct Node {
    bool is_directory = false;
    Names names, flushed_names;
    std::vector<std::byte> bytes, flushed_bytes;
  };
  /// A name that stands for a node, or for nothing any more.
  struct Assignment {
    size_t directory = 0;
    std::string name;
    std::optional<size_t> node;
  };
  using Change = std::vector<Assignment>;  // together or not at all
  struct OpenFile {
    size_t node = 0;
    std::string path;
    size_t written = 0;
    bool locked = false;
  };
  struct Place {
    size_t directory = 0;
    std::string name;
    std::optional<size_t> node;
  };

  [[nodiscard]] int Fault(Operation operation, const std::string& path);
  [[nodiscard]] size_t AtOnce(size_t asked);
  /// -ENOENT or -ENOTDIR if the directory of `path` is not there.
  [[nodiscard]] int Find(const std::string& path, Place* place) const;
  void Apply(Change change);
  [[nodiscard]] int RemoveName(const std::string& path, bool is_directory);
  void AddFiles(size_t node, const std::string& path,
                std::map<std::string, std::vector<std::byte>>* files) const;

  mutable std::mutex mutex_;
  std::vector<Node> nodes_;  // 0 is the root; none is ever taken away
  std::vector<Change> unflushed_;
  std::map<int, OpenFile> handles_;
  int next_handle_ = 3;
  int64_t calls_ = 0;
  std::atomic<int64_t> started_reads_{0};
  size_t most_open_handles_ = 0;
  std::function<int(const Call&)> fault_;
  size_t most_at_once_ = 0;
  size_t turn_ = 0;
  size_t handle_limit_ = SIZE_MAX;
};

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_SIMULATED_DISK_H_
