#include "engine/store/level_writer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/base/parallel.h"

namespace fovea::store {

LevelWriter::LevelWriter(const std::string& store_path, const std::string& field, int64_t step,
                         LevelLayout layout, EncoderPool* encoders, FileBatch* batch)
    : folder_(store_path + "/" + DetailPath(field, layout.width)),
      table_folder_(store_path + "/" + TablePath(field, layout.width)),
      step_(step),
      layout_(std::move(layout)),
      encoders_(encoders),
      batch_(batch) {}

Status LevelWriter::Add(const Int3& chunk, std::span<const std::byte> stored, float largest) {
  if (!std::isfinite(largest)) {
    return InvalidArgument("a coefficient of chunk {},{},{} (x, y, z) of detail_{} is not finite",
                           chunk.x, chunk.y, chunk.z, layout_.width);
  }
  FOVEA_ASSIGN_OR_RETURN(std::vector<std::byte> encoded,
                         encoders_->Borrow()->EncodeStored(stored, layout_.coding));
  const std::lock_guard lock(mutex_);
  layer_.push_back({chunk, std::move(encoded)});
  SetLargest(chunk, largest);
  return absl::OkStatus();
}

Status LevelWriter::EndLayer(int64_t z) {
  const std::vector<Chunk> layer = std::exchange(layer_, {});
  const int64_t row = z / layout_.shard_chunks.z;
  if (row != row_) {
    FOVEA_RETURN_IF_ERROR(FinishShards());
    row_ = row;
  }
  std::map<Position, std::vector<const Chunk*>> by_shard;
  for (const Chunk& chunk : layer) {
    const Int3 shard = layout_.ShardOf(chunk.at);
    by_shard[{shard.y, shard.x}].push_back(&chunk);
  }
  const bool is_last = (z + 1) % layout_.shard_chunks.z == 0 || z + 1 == layout_.chunks.z;
  std::vector<std::pair<ShardWriter*, std::vector<const Chunk*>>> work;
  for (auto& [at, chunks] : by_shard) {
    auto found = shards_.find(at);
    if (found == shards_.end()) {
      const std::string name = SpaceChunkName(step_, {at[1], at[0], row}, /*with_bands=*/true);
      FOVEA_ASSIGN_OR_RETURN(
          ShardWriter shard,
          ShardWriter::Start(batch_, folder_ + "/" + name,
                             static_cast<size_t>(layout_.shard_chunks.Product())));
      found = shards_.emplace(at, std::move(shard)).first;
    }
    work.emplace_back(&found->second, std::move(chunks));
  }
  std::vector<Status> results(work.size());
  ParallelFor(0, std::ssize(work), 1, 0, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const auto at = static_cast<size_t>(i);
      results[at] = WriteShard(work[at].second, is_last, work[at].first);
    }
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return is_last ? FinishShards() : absl::OkStatus();
}

/// Chunks go into a shard in the order of its index, layer by layer.
Status LevelWriter::WriteShard(const std::vector<const Chunk*>& chunks, bool is_complete,
                               ShardWriter* shard) {
  std::vector<std::pair<size_t, const Chunk*>> ordered;
  ordered.reserve(chunks.size());
  for (const Chunk* chunk : chunks) {
    ordered.emplace_back(layout_.IndexInShard(chunk->at), chunk);
  }
  std::sort(ordered.begin(), ordered.end());
  for (const auto& [place, chunk] : ordered) {
    FOVEA_RETURN_IF_ERROR(shard->Append(place, chunk->encoded));
  }
  if (is_complete) {
    return shard->Finish();
  }
  shard->Close();
  return absl::OkStatus();
}

Status LevelWriter::FinishShards() {
  for (auto& [at, shard] : shards_) {
    FOVEA_RETURN_IF_ERROR(shard.Finish());
  }
  shards_.clear();
  return absl::OkStatus();
}

Status LevelWriter::Finish() {
  FOVEA_RETURN_IF_ERROR(FinishShards());
  return WriteTable();
}

void LevelWriter::SetLargest(const Int3& chunk, float largest) {
  const Int3& edge = layout_.table_edge;
  std::vector<float>& block = table_[{chunk.z / edge.z, chunk.y / edge.y, chunk.x / edge.x}];
  block.resize(static_cast<size_t>(edge.Product()));
  block[static_cast<size_t>(((chunk.z % edge.z) * edge.y + chunk.y % edge.y) * edge.x +
                            chunk.x % edge.x)] = largest;
}

Status LevelWriter::WriteTable() {
  for (const auto& [at, block] : table_) {
    FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded,
                           encoders_->Borrow()->Encode(std::as_bytes(std::span(block))));
    const std::string name = SpaceChunkName(step_, {at[2], at[1], at[0]}, /*with_bands=*/false);
    FOVEA_RETURN_IF_ERROR(batch_->Write(table_folder_ + "/" + name, encoded));
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
