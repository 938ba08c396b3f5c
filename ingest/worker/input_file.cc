#include "ingest/worker/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace fovea::ingest {

StatusOr<InputFile> InputFile::Open(const std::string& path) {
  // O_NONBLOCK: a pipe without a writer must not keep us waiting; files do not mind.
  InputFile file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK), 0);
  struct stat about {};
  if (file.descriptor_ < 0 || ::fstat(file.descriptor_, &about) != 0) {
    return NotFound("cannot open: {}", std::strerror(errno));
  }
  if (!S_ISREG(about.st_mode)) {
    return NotFound("is not a regular file");
  }
  file.size_ = about.st_size;
  return file;
}

InputFile::~InputFile() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}

Status InputFile::ReadAt(int64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const ssize_t count = ::pread(descriptor_, out.data(), out.size(), offset);
    if (count == 0) {
      return DataLoss("the file became shorter while it was read");
    }
    if (count < 0 && errno != EINTR) {
      return DataLoss("cannot read: {}", std::strerror(errno));
    }
    if (count > 0) {
      out = out.subspan(static_cast<size_t>(count));
      offset += count;
    }
  }
  return absl::OkStatus();
}

StatusOr<std::string> InputFile::ReadStart(int64_t most) const {
  std::string bytes(static_cast<size_t>(std::min(most, size_)), '\0');
  FOVEA_RETURN_IF_ERROR(ReadAt(0, std::as_writable_bytes(std::span(bytes))));
  return bytes;
}

}  // namespace fovea::ingest
