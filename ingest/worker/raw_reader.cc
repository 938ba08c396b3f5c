#include "ingest/worker/raw_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "ingest/raw_format.h"
#include "ingest/slab_ring.h"
#include "ingest/worker/slab_sender.h"
#include "ingest/worker/to_float.h"

namespace fovea::ingest {
namespace {

class File {
 public:
  explicit File(const std::string& path)
      : descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~File() {
    if (descriptor_ >= 0) {
      ::close(descriptor_);
    }
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  [[nodiscard]] StatusOr<int64_t> Size() const {
    struct stat about {};
    if (descriptor_ < 0 || ::fstat(descriptor_, &about) != 0) {
      return NotFound("cannot open: {}", std::strerror(errno));
    }
    return static_cast<int64_t>(about.st_size);
  }

  [[nodiscard]] Status ReadAt(int64_t offset, std::span<std::byte> bytes) const {
    size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t count = ::pread(descriptor_, bytes.data() + done, bytes.size() - done,
                                    offset + static_cast<int64_t>(done));
      if (count == 0) {
        return DataLoss("the file became shorter while it was read");
      }
      if (count < 0 && errno != EINTR) {
        return DataLoss("cannot read: {}", std::strerror(errno));
      }
      done += count > 0 ? static_cast<size_t>(count) : 0;
    }
    return absl::OkStatus();
  }

 private:
  int descriptor_;
};

StatusOr<int64_t> CheckSize(const File& file, const RawFormat& format) {
  FOVEA_RETURN_IF_ERROR(CheckRawFormat(format));
  FOVEA_ASSIGN_OR_RETURN(const int64_t found, file.Size());
  const int64_t expected = BytesPerFile(format);
  if (found != expected) {
    return InvalidArgument("has {} bytes, but the raw format needs {} = {}", found, expected,
                           DescribeFileSize(format));
  }
  return found;
}

/// The type in which it travels: its own if that is one of them, else float32.
DenseType TravelType(const std::string& type) {
  constexpr std::pair<std::string_view, DenseType> kAsTheyAre[] = {
      {"uint8", DenseType::kUint8},
      {"int8", DenseType::kInt8},
      {"uint16", DenseType::kUint16},
      {"int16", DenseType::kInt16},
  };
  for (const auto& [name, travels] : kAsTheyAre) {
    if (name == type) {
      return travels;
    }
  }
  return DenseType::kFloat32;
}

/// This machine is little-endian (payload.h sees to it), so big-endian values are swapped.
void Swap(std::span<std::byte> bytes, size_t size) {
  for (size_t i = 0; i + size <= bytes.size(); i += size) {
    std::reverse(bytes.data() + i, bytes.data() + i + size);
  }
}

template <typename T>
uint64_t Convert(std::span<const std::byte> bytes, std::byte* to) {
  uint64_t rounded = 0;
  for (size_t i = 0; i + sizeof(T) <= bytes.size(); i += sizeof(T), to += sizeof(float)) {
    T value;
    std::memcpy(&value, bytes.data() + i, sizeof(T));
    const float converted = ToFloat(value, &rounded);
    std::memcpy(to, &converted, sizeof(float));
  }
  return rounded;
}

using Converter = uint64_t (*)(std::span<const std::byte>, std::byte*);

/// Null: it travels as it is.
Converter ConverterOf(const std::string& type) {
  return type == "uint32"    ? Convert<uint32_t>
         : type == "int32"   ? Convert<int32_t>
         : type == "float64" ? Convert<double>
                             : nullptr;
}

}  // namespace

Status ScanRaw(const ScanRequest& request, Channel* channel) {
  const RawFormat& format = *request.raw;
  const File file(request.path);
  FOVEA_ASSIGN_OR_RETURN(const int64_t bytes, CheckSize(file, format));
  FOVEA_RETURN_IF_ERROR(channel->Send(Encode(FileInfo{bytes, ""}), Channel::kNoDeadline));
  GridInfo grid;
  grid.type = format.type;
  grid.box = Box3::OfSize(format.dims);
  return channel->Send(Encode(grid), Channel::kNoDeadline);
}

Status ReadRaw(const ReadRequest& request, Channel* channel) {
  const RawFormat& format = *request.raw;
  const File file(request.path);
  FOVEA_RETURN_IF_ERROR(CheckSize(file, format).status());
  if (request.grids.size() != 1 || request.extent != Box3::OfSize(format.dims) ||
      request.step_in_file < 0 || request.step_in_file >= format.steps_per_file) {
    return InvalidArgument("a request that does not fit the raw format");
  }
  const DenseType travels = TravelType(format.type);
  SlabSender sender(channel);
  FOVEA_RETURN_IF_ERROR(sender.Start({0, travels, request.extent}));
  int64_t offset = format.header_bytes + request.step_in_file * BytesPerStep(format);
  FieldEnd end{request.extent, 0};
  const Converter convert = ConverterOf(format.type);
  const int64_t row_bytes = format.dims.x * BytesPerValue(format.type);
  const int64_t at_once = static_cast<int64_t>(kSlabBytes) / (format.dims.x * BytesOf(travels));
  std::vector<std::byte> converted;
  for (int64_t left = format.dims.y * format.dims.z; left > 0;) {
    const int64_t rows = std::min(left, at_once);
    const auto bytes = static_cast<size_t>(rows * row_bytes);
    FOVEA_ASSIGN_OR_RETURN(const std::span<std::byte> slab, sender.Next());
    converted.resize(convert == nullptr ? 0 : bytes);
    const std::span<std::byte> read = convert == nullptr ? slab.first(bytes) : std::span(converted);
    FOVEA_RETURN_IF_ERROR(file.ReadAt(offset, read));
    if (format.big_endian) {
      Swap(read, static_cast<size_t>(BytesPerValue(format.type)));
    }
    end.rounded += convert == nullptr ? 0 : convert(read, slab.data());
    FOVEA_RETURN_IF_ERROR(sender.Send(rows));
    offset += static_cast<int64_t>(bytes);
    left -= rows;
  }
  return sender.Finish(end);
}

}  // namespace fovea::ingest
