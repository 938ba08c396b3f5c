#include "service/export/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

namespace fovea::exports {
namespace {

Status WriteError(const std::string& path, int error) {
  const std::string why = std::generic_category().message(error);
  switch (error) {
    case ENOSPC:
    case EDQUOT:
      return ResourceExhausted(
          "cannot write {}: the disk is full ({}); free some space, or write "
          "elsewhere",
          path, why);
    case EFBIG:
      return ResourceExhausted(
          "cannot write {}: the limit on file sizes is reached ({}); see "
          "`ulimit -f`",
          path, why);
    default:
      return FailedPrecondition("cannot write {}: {}", path, why);
  }
}

}  // namespace

Status MakeParentFolder(const std::string& path) {
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  if (!folder.empty() && !std::filesystem::create_directories(folder, error) && error) {
    return WriteError(folder.string(), error.value());
  }
  return absl::OkStatus();
}

StatusOr<OutputFile> OutputFile::Create(const std::string& path) {
  FOVEA_RETURN_IF_ERROR(MakeParentFolder(path));
  const std::filesystem::path target(path);
  if (std::error_code error; std::filesystem::is_directory(target, error)) {
    return FailedPrecondition("cannot write {}: it is a folder", path);
  }
  // The process id tells the temporary files of shards in one folder apart.
  const std::string temporary =
      (target.parent_path() / fmt::format(".{}.{}.tmp", target.filename().string(), ::getpid()))
          .string();
  const int descriptor = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) {
    return WriteError(path, errno);
  }
  return OutputFile(path, temporary, descriptor);
}

OutputFile::OutputFile(OutputFile&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_path_(std::exchange(other.temporary_path_, {})),
      descriptor_(std::exchange(other.descriptor_, -1)) {}

OutputFile::~OutputFile() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
  if (!temporary_path_.empty()) {
    ::unlink(temporary_path_.c_str());
  }
}

Status OutputFile::Write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) {
      continue;
    }
    if (written < 0) {
      return WriteError(path_, errno);
    }
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

Status OutputFile::Commit() {
  // close() is where some file systems report that the disk is full.
  if (::close(std::exchange(descriptor_, -1)) != 0 ||
      std::rename(temporary_path_.c_str(), path_.c_str()) != 0) {
    return WriteError(path_, errno);
  }
  temporary_path_.clear();
  return absl::OkStatus();
}

Status WriteWholeFile(const std::string& path, std::string_view bytes) {
  FOVEA_ASSIGN_OR_RETURN(OutputFile file, OutputFile::Create(path));
  FOVEA_RETURN_IF_ERROR(file.Write(bytes));
  return file.Commit();
}

}  // namespace fovea::exports
