#ifndef SERVICE_EXPORT_OUTPUT_FILE_H_
#define SERVICE_EXPORT_OUTPUT_FILE_H_

#include <string>
#include <string_view>

#include "engine/base/status.h"

namespace fovea::exports {

/// A file that appears under its name whole or not at all: written beside it under a temporary
/// name, renamed by Commit, removed if it is destroyed before that. Not thread-safe.
class OutputFile {
 public:
  /// Makes the folder it lies in too, and those above.
  [[nodiscard]] static StatusOr<OutputFile> Create(const std::string& path);
  OutputFile(OutputFile&& other) noexcept;
  OutputFile& operator=(OutputFile&&) = delete;
  ~OutputFile();

  /// RESOURCE_EXHAUSTED when the disk is full or a limit on the file's size is reached.
  [[nodiscard]] Status Write(std::string_view bytes);
  [[nodiscard]] Status Commit();

  /// Where the bytes are until Commit: for programs that write the file themselves.
  [[nodiscard]] const std::string& temporary_path() const { return temporary_path_; }

 private:
  OutputFile(std::string path, std::string temporary_path, int descriptor)
      : path_(std::move(path)),
        temporary_path_(std::move(temporary_path)),
        descriptor_(descriptor) {}

  std::string path_;
  std::string temporary_path_;  // empty: nothing to remove
  int descriptor_ = -1;
};

/// The whole file at once.
[[nodiscard]] Status WriteWholeFile(const std::string& path, std::string_view bytes);

/// Makes the folder that `path` lies in, and those above it.
[[nodiscard]] Status MakeParentFolder(const std::string& path);

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_OUTPUT_FILE_H_
