#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "ingest/ingest.h"
#include "ingest/protocol.h"
#include "ingest/worker_client.h"

namespace fovea::ingest {
namespace {

/// "exr" or "tif" by the name's extension; empty if it is neither.
std::string PictureFormat(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return c < 0x80 ? std::tolower(c) : c; });
  return extension == ".exr" ? "exr" : extension == ".tif" || extension == ".tiff" ? "tif" : "";
}

/// Asks a worker for the bytes of the file. It stays for the next picture, because it takes most
/// of a second to be ready; it goes with this process.
StatusOr<std::string> Encoded(const std::string& path, const PictureRequest& request,
                              const std::vector<float>& rgba) {
  static std::mutex mutex;
  static auto* client = [] {
    WorkerOptions options;
    options.limits.memory_bytes = 0;   // it reads nothing foreign
    options.dies_with_thread = false;  // the next picture may come from another
    options.pictures = true;
    return new WorkerClient(options);
  }();
  const size_t most = rgba.size() * sizeof(float) + (size_t{16} << 20);
  const std::string_view pixels(reinterpret_cast<const char*>(rgba.data()),
                                rgba.size() * sizeof(float));
  std::string encoded;
  const std::lock_guard lock(mutex);
  FOVEA_RETURN_IF_ERROR(
      client->Call(path, Encode(request), pixels, [&](const FrameView& reply) -> Status {
        if (reply.kind != FrameKind::kBytes || reply.payload.size() > most - encoded.size()) {
          return Internal("malformed message: an encoded picture");
        }
        encoded += reply.payload;
        return absl::OkStatus();
      }));
  return encoded;
}

Status WriteError(const std::string& path, int error) {
  const bool is_full = error == ENOSPC || error == EDQUOT;
  return MakeStatus(
      is_full ? absl::StatusCode::kResourceExhausted : absl::StatusCode::kFailedPrecondition,
      fmt::format("cannot write '{}': {}", path, std::strerror(error)));
}

/// Writes a new file; `path` names it in errors.
Status WriteNewFile(const std::string& name, std::string_view bytes, const std::string& path) {
  const int file = ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) {
    return WriteError(path, errno);
  }
  while (!bytes.empty()) {
    const ssize_t count = ::write(file, bytes.data(), bytes.size());
    if (count < 0 && errno != EINTR) {
      const int error = errno;
      ::close(file);
      return WriteError(path, error);
    }
    bytes.remove_prefix(count > 0 ? static_cast<size_t>(count) : 0);
  }
  return ::close(file) == 0 ? absl::OkStatus() : WriteError(path, errno);
}

}  // namespace

Status WritePictureFile(const std::string& path, int width, int height,
                        const std::vector<float>& rgba) {
  constexpr int kMaxSide = 16384;
  const std::string format = PictureFormat(path);
  if (format.empty()) {
    return InvalidArgument("'{}': the name must end in .exr, .tif or .tiff", path);
  }
  if (width < 1 || width > kMaxSide || height < 1 || height > kMaxSide ||
      rgba.size() != size_t{4} * static_cast<size_t>(width) * static_cast<size_t>(height)) {
    return InvalidArgument("'{}': {} x {} pixels with {} values: 1 to {} a side, 4 values a pixel",
                           path, width, height, rgba.size(), kMaxSide);
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string bytes, Encoded(path, {format, width, height}, rgba));
  static std::atomic<uint64_t> count = 0;
  const std::filesystem::path target(path);
  const std::string temporary =
      (target.parent_path() /
       fmt::format(".{}.{}-{}.tmp", target.filename().string(), ::getpid(), ++count))
          .string();
  Status status = WriteNewFile(temporary, bytes, path);
  if (status.ok() && ::rename(temporary.c_str(), path.c_str()) != 0) {
    status = WriteError(path, errno);
  }
  if (!status.ok()) {
    ::unlink(temporary.c_str());
  }
  return status;
}

}  // namespace fovea::ingest
