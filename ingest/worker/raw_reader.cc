#include "ingest/worker/raw_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "ingest/raw_format.h"
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

  [[nodiscard]] Status ReadAt(int64_t offset, std::vector<char>* bytes) const {
    size_t done = 0;
    while (done < bytes->size()) {
      const ssize_t count = ::pread(descriptor_, bytes->data() + done, bytes->size() - done,
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

/// This machine is little-endian (payload.h sees to it), so big-endian values are swapped.
template <typename T>
uint64_t Convert(const std::vector<char>& bytes, bool swap, std::vector<float>* values) {
  uint64_t rounded = 0;
  for (size_t i = 0; i < values->size(); ++i) {
    char raw[sizeof(T)];
    std::memcpy(raw, bytes.data() + i * sizeof(T), sizeof(T));
    if (swap) {
      std::reverse(raw, raw + sizeof(T));
    }
    (*values)[i] = ToFloat(std::bit_cast<T>(raw), &rounded);
  }
  return rounded;
}

using Converter = uint64_t (*)(const std::vector<char>&, bool, std::vector<float>*);

Converter ConverterOf(const std::string& type) {
  constexpr std::pair<std::string_view, Converter> kConverters[] = {
      {"uint8", Convert<uint8_t>}, {"int8", Convert<int8_t>},     {"uint16", Convert<uint16_t>},
      {"int16", Convert<int16_t>}, {"uint32", Convert<uint32_t>}, {"int32", Convert<int32_t>},
      {"float32", Convert<float>}, {"float64", Convert<double>},
  };
  for (const auto& [name, converter] : kConverters) {
    if (name == type) {
      return converter;
    }
  }
  return nullptr;  // CheckRawFormat knows the same types
}

/// The next slab from `at` (y, z) on: whole slices, or rows of one slice where a slice is too
/// large.
Box3 NextSlab(const Int3& dims, int64_t y, int64_t z) {
  const int64_t rows = std::max<int64_t>(1, kMaxBlockValues / dims.x);
  if (y > 0 || rows < dims.y) {
    return {{0, y, z}, {dims.x, std::min(dims.y, y + rows), z + 1}};
  }
  return {{0, 0, z}, {dims.x, dims.y, std::min(dims.z, z + rows / dims.y)}};
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
  FOVEA_RETURN_IF_ERROR(channel->Send(Encode(FieldStart{}), Channel::kNoDeadline));
  int64_t offset = format.header_bytes + request.step_in_file * BytesPerStep(format);
  FieldEnd end{request.extent, 0};
  const Converter convert = ConverterOf(format.type);
  std::vector<char> bytes;
  std::vector<float> values;
  for (int64_t z = 0, y = 0; z < format.dims.z;) {
    const Box3 slab = NextSlab(format.dims, y, z);
    bytes.resize(static_cast<size_t>(slab.Volume() * BytesPerValue(format.type)));
    values.resize(static_cast<size_t>(slab.Volume()));
    FOVEA_RETURN_IF_ERROR(file.ReadAt(offset, &bytes));
    end.rounded += convert(bytes, format.big_endian, &values);
    FOVEA_RETURN_IF_ERROR(channel->Send(EncodeBlock(slab, values), Channel::kNoDeadline));
    offset += static_cast<int64_t>(bytes.size());
    y = slab.hi.y < format.dims.y ? slab.hi.y : 0;
    z = y > 0 ? z : slab.hi.z;
  }
  return channel->Send(Encode(end), Channel::kNoDeadline);
}

}  // namespace fovea::ingest
