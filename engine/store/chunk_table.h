#ifndef ENGINE_STORE_CHUNK_TABLE_H_
#define ENGINE_STORE_CHUNK_TABLE_H_

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/layout.h"

namespace fovea::store {

/// chunk_max_W of one level of one field of one step: the largest |coefficient| of each chunk.
/// Blocks are read as they are asked for, and kept. Thread-safe.
class ChunkTable {
 public:
  ChunkTable(std::string store_path, const std::string& field, int64_t step,
             const LevelLayout& layout);

  /// One block, [z][y][x] of layout.table_edge entries; empty if its file is not there, which is
  /// so where all its chunks are zero. DATA_LOSS if it is damaged.
  [[nodiscard]] StatusOr<std::vector<float>> Block(const Int3& block);
  /// How many chunks of the level are stored; what cannot be read counts for nothing.
  [[nodiscard]] uint64_t StoredChunks();
  /// Bytes read from files so far.
  [[nodiscard]] uint64_t bytes_read() const;

  [[nodiscard]] Int3 BlockOf(const Int3& chunk) const;
  /// The place of a chunk in its block.
  [[nodiscard]] size_t IndexInBlock(const Int3& chunk) const;

 private:
  std::string folder_;
  int64_t step_;
  LevelLayout layout_;
  mutable std::mutex mutex_;
  std::map<std::array<int64_t, 3>, std::vector<float>> blocks_;  // guarded by mutex_
  uint64_t bytes_read_ = 0;                                      // guarded by mutex_
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_CHUNK_TABLE_H_
