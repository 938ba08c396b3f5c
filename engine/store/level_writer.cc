#include "engine/store/level_writer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "engine/base/parallel.h"
#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"

namespace fovea::store {
namespace {

/// Raw bytes of chunks that are encoded before they are written: what a level needs in memory.
constexpr int64_t kBatchBytes = 8 << 20;

struct Chunk {
  Int3 at;
  const BrickGrid::Brick* brick = nullptr;
  float largest = 0;               // |coefficient|; 0: not stored
  std::vector<std::byte> encoded;  // empty if not stored
};

/// The brick with zeros past the border of the level.
BrickGrid::Brick CutAtBorder(const LevelLayout& layout, const Chunk& chunk) {
  const Box3 box = layout.ChunkBox(chunk.at);
  const Int3 size = box.Size();
  const int64_t edge = layout.edge;
  BrickGrid::Brick cut(chunk.brick->size(), 0.0F);
  for (int64_t band = 0; band < kSubBands; ++band) {
    for (int64_t z = 0; z < size.z; ++z) {
      for (int64_t y = 0; y < size.y; ++y) {
        const int64_t row = ((band * edge + z) * edge + y) * edge;
        std::copy_n(chunk.brick->data() + row, size.x, cut.data() + row);
      }
    }
  }
  return cut;
}

Status EncodeChunk(const LevelLayout& layout, Encoder* encoder, Chunk* chunk) {
  BrickGrid::Brick cut;
  const BrickGrid::Brick* values = chunk->brick;
  if (layout.ChunkBox(chunk->at).Size() != Int3{layout.edge, layout.edge, layout.edge}) {
    cut = CutAtBorder(layout, *chunk);
    values = &cut;
  }
  bool finite = true;
  float largest = 0;
  for (const float value : *values) {
    finite = finite && std::isfinite(value);
    largest = std::max(largest, std::fabs(value));
  }
  if (!finite) {
    return InvalidArgument("a coefficient of chunk {},{},{} (x, y, z) of detail_{} is not finite",
                           chunk->at.x, chunk->at.y, chunk->at.z, layout.width);
  }
  chunk->largest = largest;
  if (largest == 0) {
    return absl::OkStatus();
  }
  if (!IsIntegerType(layout.type)) {
    FOVEA_ASSIGN_OR_RETURN(chunk->encoded, encoder->Encode(std::as_bytes(std::span(*values))));
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> stored, ToStored(*values, layout.type));
  FOVEA_ASSIGN_OR_RETURN(chunk->encoded, encoder->Encode(stored));
  return absl::OkStatus();
}

/// Encodes chunks[first, last) on all processors.
Status EncodeChunks(const LevelLayout& layout, std::span<Chunk> chunks) {
  std::vector<Status> results(chunks.size());
  ParallelFor(0, static_cast<int64_t>(chunks.size()), 4, 0, [&](int64_t first, int64_t last) {
    Encoder encoder;
    for (int64_t i = first; i < last; ++i) {
      const auto at = static_cast<size_t>(i);
      results[at] = EncodeChunk(layout, &encoder, &chunks[at]);
    }
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return absl::OkStatus();
}

using Position = std::array<int64_t, 3>;  // z, y, x: in the order of files

Position PositionOf(const Int3& at) {
  return {at.z, at.y, at.x};
}

std::map<Position, std::vector<Chunk>> ChunksByShard(const LevelLayout& layout,
                                                     const BrickGrid& detail) {
  std::map<Position, std::vector<Chunk>> shards;
  for (const auto& [key, brick] : detail.bricks()) {
    const Int3 at{key[2], key[1], key[0]};
    shards[PositionOf(layout.ShardOf(at))].push_back({at, &brick, 0, {}});
  }
  return shards;
}

/// The table of the largest |coefficient| of each chunk, in blocks of which only those that hold
/// anything are there.
class MaximumTable {
 public:
  explicit MaximumTable(const LevelLayout& layout) : layout_(layout) {}

  void Set(const Int3& chunk, float largest) {
    const Int3& edge = layout_.table_edge;
    std::vector<float>& block = blocks_[{chunk.z / edge.z, chunk.y / edge.y, chunk.x / edge.x}];
    block.resize(static_cast<size_t>(edge.Product()));
    block[static_cast<size_t>(((chunk.z % edge.z) * edge.y + chunk.y % edge.y) * edge.x +
                              chunk.x % edge.x)] = largest;
  }

  [[nodiscard]] Status Write(const std::string& folder, int64_t step, FileBatch* batch) const {
    Encoder encoder;
    for (const auto& [at, block] : blocks_) {
      FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded,
                             encoder.Encode(std::as_bytes(std::span(block))));
      const std::string name = SpaceChunkName(step, {at[2], at[1], at[0]}, /*with_bands=*/false);
      FOVEA_RETURN_IF_ERROR(batch->Write(folder + "/" + name, encoded));
    }
    return absl::OkStatus();
  }

 private:
  const LevelLayout& layout_;
  std::map<Position, std::vector<float>> blocks_;
};

Status WriteShard(const LevelLayout& layout, const std::string& path, std::span<Chunk> chunks,
                  FileBatch* batch, MaximumTable* table) {
  std::optional<ShardWriter> shard;  // started with the first chunk that is not all zeros
  const auto at_once = static_cast<size_t>(std::max<int64_t>(8, kBatchBytes / layout.ChunkBytes()));
  for (size_t first = 0; first < chunks.size(); first += at_once) {
    const std::span<Chunk> some = chunks.subspan(first, std::min(at_once, chunks.size() - first));
    FOVEA_RETURN_IF_ERROR(EncodeChunks(layout, some));
    for (Chunk& chunk : some) {
      if (chunk.largest == 0) {
        continue;
      }
      if (!shard) {
        FOVEA_ASSIGN_OR_RETURN(WritableFile file, batch->Start(path));
        shard.emplace(std::move(file), static_cast<size_t>(layout.shard_chunks.Product()));
      }
      FOVEA_RETURN_IF_ERROR(shard->Append(layout.IndexInShard(chunk.at), chunk.encoded));
      table->Set(chunk.at, chunk.largest);
      chunk.encoded = {};
    }
  }
  return shard ? shard->Finish() : absl::OkStatus();
}

}  // namespace

Status WriteLevel(const std::string& store_path, const std::string& field, int64_t step,
                  const LevelLayout& layout, const BrickGrid& detail, FileBatch* batch) {
  const std::string folder = store_path + "/" + DetailPath(field, layout.width);
  MaximumTable table(layout);
  for (auto& [at, chunks] : ChunksByShard(layout, detail)) {
    const std::string name = SpaceChunkName(step, {at[2], at[1], at[0]}, /*with_bands=*/true);
    FOVEA_RETURN_IF_ERROR(WriteShard(layout, folder + "/" + name, chunks, batch, &table));
  }
  return table.Write(store_path + "/" + TablePath(field, layout.width), step, batch);
}

}  // namespace fovea::store
