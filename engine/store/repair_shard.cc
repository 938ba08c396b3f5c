#include "engine/store/repair_shard.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>

#include "engine/store/blosc.h"
#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"

namespace fovea::store {
namespace {

/// A shard that is longer is not searched: it would have to be in memory.
constexpr int64_t kMaxSearchedBytes = int64_t{1} << 30;

/// How long the encoded chunk that begins `bytes` says it is, its CRC32C included; nothing if none
/// begins there. Of the header of a Blosc chunk: version, size of the values, size of the chunk.
std::optional<size_t> EncodedBytes(const LevelLayout& layout, std::span<const std::byte> bytes) {
  constexpr size_t kCrcBytes = 4;
  constexpr std::byte kBloscVersion{2};
  uint32_t sizes[3];  // values, block, chunk
  if (bytes.size() < kBloscHeaderBytes || bytes[0] != kBloscVersion) {
    return std::nullopt;
  }
  std::memcpy(sizes, bytes.data() + 4, sizeof(sizes));
  return sizes[0] == static_cast<uint64_t>(layout.ChunkBytes())
             ? std::optional<size_t>(sizes[2] + kCrcBytes)
             : std::nullopt;
}

/// Every sound chunk of the file, in the order in which they lie; not yet placed.
std::vector<FoundChunk> AllChunks(const LevelLayout& layout, std::span<const std::byte> bytes) {
  std::vector<FoundChunk> found;
  Decoder decoder;
  std::vector<float> values(static_cast<size_t>(layout.ChunkValues()));
  size_t at = 0;
  while (at < bytes.size()) {
    const std::optional<size_t> size = EncodedBytes(layout, bytes.subspan(at));
    if (size && *size <= bytes.size() - at) {
      const StatusOr<float> largest =
          LargestOfChunk(bytes.subspan(at, *size), layout, &decoder, &values);
      if (largest.ok() && *largest > 0) {
        found.push_back({{}, {at, *size}, {}, *largest});
        at += *size;
        continue;
      }
    }
    ++at;
  }
  return found;
}

/// The chunks that the table has of the shard, in the order of its index.
std::vector<Int3> ExpectedChunks(const FoundLevel& level, const FoundShard& shard) {
  std::vector<Int3> expected;
  const auto places = static_cast<size_t>(level.layout.shard_chunks.Product());
  for (size_t place = 0; place < places; ++place) {
    const Int3 at = level.layout.ChunkInShard(shard.shard, place);
    if (level.Largest(at) != 0) {
      expected.push_back(at);
    }
  }
  return expected;
}

}  // namespace

StatusOr<std::vector<FoundChunk>> FindChunks(FileSystem& files, const FoundLevel& level,
                                             const FoundShard& shard) {
  const StatusOr<std::vector<std::byte>> bytes =
      ReadWholeFile(files, shard.path, kMaxSearchedBytes);
  if (absl::IsDataLoss(bytes.status())) {
    return std::vector<FoundChunk>();
  }
  FOVEA_RETURN_IF_ERROR(bytes.status());
  std::vector<FoundChunk> found = AllChunks(level.layout, *bytes);
  const std::vector<Int3> expected = ExpectedChunks(level, shard);
  const auto same = [&](const FoundChunk& chunk, const Int3& at) {
    return chunk.largest == level.Largest(at);
  };
  if (std::equal(found.begin(), found.end(), expected.begin(), expected.end(), same)) {
    for (size_t i = 0; i < found.size(); ++i) {
      found[i].at = expected[i];
    }
    return found;
  }
  std::map<float, std::vector<Int3>> places;
  std::map<float, size_t> times;
  for (const Int3& at : expected) {
    places[level.Largest(at)].push_back(at);
  }
  for (const FoundChunk& chunk : found) {
    ++times[chunk.largest];
  }
  std::vector<FoundChunk> placed;
  for (FoundChunk& chunk : found) {
    const auto place = places.find(chunk.largest);
    if (place != places.end() && place->second.size() == 1 && times[chunk.largest] == 1) {
      chunk.at = place->second.front();
      placed.push_back(chunk);
    }
  }
  return placed;
}

Status CopyChunks(FileSystem& files, const LevelLayout& layout, const std::string& from,
                  std::span<const FoundChunk> chunks, const std::string& to, FileBatch* batch) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile source, ReadableFile::Open(files, from));
  FOVEA_ASSIGN_OR_RETURN(
      ShardWriter shard,
      ShardWriter::Start(batch, to, static_cast<size_t>(layout.shard_chunks.Product())));
  std::vector<std::byte> bytes;
  for (const FoundChunk& chunk : chunks) {
    bytes.resize(chunk.entry.bytes);
    FOVEA_RETURN_IF_ERROR(source.ReadAt(static_cast<int64_t>(chunk.entry.offset), bytes));
    FOVEA_RETURN_IF_ERROR(shard.Append(layout.IndexInShard(chunk.at), bytes));
  }
  return shard.Finish();
}

}  // namespace fovea::store
