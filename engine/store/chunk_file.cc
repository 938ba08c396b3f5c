#include "engine/store/chunk_file.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

namespace fovea::store {
namespace {

constexpr uint64_t kAbsent = std::numeric_limits<uint64_t>::max();

}  // namespace

StatusOr<int64_t> ReadChunkFile(FileSystem& files, const std::string& path,
                                std::span<std::byte> raw) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile file, ReadableFile::Open(files, path));
  return ReadChunkFile(file, raw);
}

StatusOr<int64_t> ReadChunkFile(const ReadableFile& file, std::span<std::byte> raw) {
  const int64_t most = MaxEncodedBytes(static_cast<int64_t>(raw.size()));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded, file.ReadWhole(most));
  FOVEA_RETURN_IF_ERROR(
      Annotate(Decoder().Decode(encoded, raw), fmt::format("{} is damaged", file.path())));
  return static_cast<int64_t>(encoded.size());
}

StatusOr<int64_t> ReadValuesFile(FileSystem& files, const std::string& path, const Coding& coding,
                                 std::span<float> values) {
  const int64_t most = MaxEncodedBytes(std::ssize(values) * BytesOfType(coding.type));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded, ReadWholeFile(files, path, most));
  FOVEA_RETURN_IF_ERROR(Annotate(Decoder().DecodeValues(encoded, coding, values),
                                 fmt::format("{} is damaged", path)));
  return static_cast<int64_t>(encoded.size());
}

int64_t ShardIndexBytes(size_t chunks) {
  return static_cast<int64_t>(chunks * 2 * sizeof(uint64_t) + sizeof(uint32_t));
}

void StartShardIndex(const ReadableFile& file, size_t chunks) {
  const int64_t bytes = ShardIndexBytes(chunks);
  file.StartRead(std::max<int64_t>(file.size() - bytes, 0), bytes);
}

StatusOr<ShardIndex> ReadShardIndex(const ReadableFile& file, size_t chunks,
                                    int64_t max_chunk_bytes) {
  std::vector<std::byte> bytes(static_cast<size_t>(ShardIndexBytes(chunks)));
  const int64_t start = file.size() - static_cast<int64_t>(bytes.size());
  if (start < 0) {
    return DataLoss("{} is damaged: {} bytes are too few for its index", file.path(), file.size());
  }
  FOVEA_RETURN_IF_ERROR(file.ReadAt(start, bytes));
  const StatusOr<std::span<const std::byte>> content = CheckCrc32c(bytes);
  FOVEA_RETURN_IF_ERROR(
      Annotate(content.status(), fmt::format("{} is damaged: its index", file.path())));
  ShardIndex index(chunks);
  for (size_t place = 0; place < chunks; ++place) {
    uint64_t entry[2];
    std::memcpy(entry, content->data() + place * sizeof(entry), sizeof(entry));
    const auto [offset, size] = entry;
    if (offset == kAbsent && size == kAbsent) {
      continue;
    }
    const auto end = static_cast<uint64_t>(start);
    if (offset > end || size > end - offset || size > static_cast<uint64_t>(max_chunk_bytes)) {
      return DataLoss("{} is damaged: its index says that chunk {} has {} bytes at {}", file.path(),
                      place, size, offset);
    }
    index[place] = ShardEntry{offset, size};
  }
  return index;
}

StatusOr<ShardWriter> ShardWriter::Start(FileBatch* batch, const std::string& path, size_t chunks) {
  FOVEA_ASSIGN_OR_RETURN(WritableFile file, batch->Start(path));
  return ShardWriter(std::move(file), chunks);
}

Status ShardWriter::Append(size_t place, std::span<const std::byte> encoded) {
  index_[place] = ShardEntry{file_.size(), encoded.size()};
  return file_.Append(encoded);
}

Status ShardWriter::Finish() {
  if (std::exchange(is_finished_, true)) {
    return absl::OkStatus();
  }
  std::vector<std::byte> bytes;
  for (const std::optional<ShardEntry>& entry : index_) {
    const uint64_t pair[2] = {entry ? entry->offset : kAbsent, entry ? entry->bytes : kAbsent};
    const auto raw = std::as_bytes(std::span(pair));
    bytes.insert(bytes.end(), raw.begin(), raw.end());
  }
  AppendCrc32c(bytes);
  FOVEA_RETURN_IF_ERROR(file_.Append(bytes));
  Close();
  return absl::OkStatus();
}

std::string SeriesPath(const std::string& store_path, const std::string& array, int64_t step,
                       int64_t steps, bool has_rows) {
  std::vector<int64_t> indices = {step / steps};
  if (has_rows) {
    indices.push_back(0);
  }
  return fmt::format("{}/{}/{}", store_path, array, ChunkName(indices));
}

}  // namespace fovea::store
