#ifndef INGEST_WORKER_INPUT_FILE_H_
#define INGEST_WORKER_INPUT_FILE_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "engine/base/status.h"

namespace fovea::ingest {

/// A regular file, open for reading.
class InputFile {
 public:
  /// NOT_FOUND, without the name, if it cannot be opened or is not a regular file.
  [[nodiscard]] static StatusOr<InputFile> Open(const std::string& path);
  InputFile(InputFile&& other) noexcept
      : descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}
  InputFile& operator=(InputFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    size_ = other.size_;
    return *this;
  }
  ~InputFile();

  /// When it was opened.
  [[nodiscard]] int64_t size() const { return size_; }
  /// Fills `out`; DATA_LOSS if the file ends before.
  [[nodiscard]] Status ReadAt(int64_t offset, std::span<std::byte> out) const;
  /// The first bytes of the file: `most`, or all.
  [[nodiscard]] StatusOr<std::string> ReadStart(int64_t most) const;

 private:
  InputFile(int descriptor, int64_t size) : descriptor_(descriptor), size_(size) {}

  int descriptor_ = -1;
  int64_t size_ = 0;
};

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_INPUT_FILE_H_
