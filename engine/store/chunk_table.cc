#include "engine/store/chunk_table.h"

#include <algorithm>
#include <optional>
#include <span>
#include <utility>

#include "engine/store/chunk_file.h"

namespace fovea::store {
namespace {

/// Above so many blocks a level its folder is listed: most of a volume that large are not there,
/// and to look for each in vain takes a second a million.
constexpr int64_t kMostTried = 1024;

}  // namespace

ChunkTable::ChunkTable(FileSystem& files, std::string store_path, const std::string& field,
                       int64_t step, const LevelLayout& layout)
    : files_(files),
      folder_(std::move(store_path) + "/" + TablePath(field, layout.width)),
      step_(step),
      layout_(layout) {}

Int3 ChunkTable::BlockOf(const Int3& chunk) const {
  const Int3& edge = layout_.table_edge;
  return {chunk.x / edge.x, chunk.y / edge.y, chunk.z / edge.z};
}

size_t ChunkTable::IndexInBlock(const Int3& chunk) const {
  const Int3& edge = layout_.table_edge;
  return static_cast<size_t>(((chunk.z % edge.z) * edge.y + chunk.y % edge.y) * edge.x +
                             chunk.x % edge.x);
}

StatusOr<ReadableFile> ChunkTable::OpenBlock(const Int3& block) const {
  return ReadableFile::Open(files_,
                            folder_ + "/" + SpaceChunkName(step_, block, /*with_bands=*/false));
}

void ChunkTable::StartFirstBlock() {
  const std::lock_guard lock(mutex_);
  if (first_ || blocks_.contains({0, 0, 0})) {
    return;
  }
  first_ = OpenBlock({0, 0, 0});
  if (first_->ok()) {
    (*first_)->StartRead(0, (*first_)->size());
  }
}

StatusOr<const std::vector<float>*> ChunkTable::Block(const Int3& block, uint64_t* bytes_read) {
  const std::lock_guard lock(mutex_);
  const std::array<int64_t, 3> key{block.z, block.y, block.x};
  if (const auto known = blocks_.find(key); known != blocks_.end()) {
    return &known->second;
  }
  const bool begun = block == Int3{0, 0, 0} && first_.has_value();
  const StatusOr<ReadableFile> file =
      begun ? *std::exchange(first_, std::nullopt) : OpenBlock(block);
  std::vector<float> values;
  if (file.ok()) {
    values.resize(static_cast<size_t>(layout_.table_edge.Product()));
    FOVEA_ASSIGN_OR_RETURN(const int64_t bytes,
                           ReadChunkFile(*file, std::as_writable_bytes(std::span(values))));
    *bytes_read += static_cast<uint64_t>(bytes);
  } else if (!absl::IsNotFound(file.status())) {
    return file.status();
  }
  return &(blocks_[key] = std::move(values));
}

std::vector<Int3> ChunkTable::BlocksToCount() const {
  std::vector<Int3> blocks;
  if (layout_.tables.Product() <= kMostTried) {
    for (int64_t z = 0; z < layout_.tables.z; ++z) {
      for (int64_t y = 0; y < layout_.tables.y; ++y) {
        for (int64_t x = 0; x < layout_.tables.x; ++x) {
          blocks.push_back({x, y, z});
        }
      }
    }
    return blocks;
  }
  const auto names = ListDirectory(files_, folder_);
  const std::string of_step = fmt::format("c.{}.", step_);
  for (const std::string& name : names.value_or(std::vector<std::string>())) {
    if (!name.starts_with(of_step)) {
      continue;
    }
    const auto at = ParseChunkName(name, 4);  // t, z, y, x
    if (at && Box3::OfSize(layout_.tables).Contains(Int3{(*at)[3], (*at)[2], (*at)[1]})) {
      blocks.push_back({(*at)[3], (*at)[2], (*at)[1]});
    }
  }
  return blocks;
}

uint64_t ChunkTable::StoredChunks() {
  uint64_t stored = 0;
  uint64_t bytes_read = 0;
  for (const Int3& at : BlocksToCount()) {
    if (const auto block = Block(at, &bytes_read); block.ok()) {
      stored += static_cast<uint64_t>(
          std::count_if((*block)->begin(), (*block)->end(), [](float value) { return value > 0; }));
    }
  }
  return stored;
}

}  // namespace fovea::store
