#ifndef ENGINE_STORE_CHUNK_TABLE_H_
#define ENGINE_STORE_CHUNK_TABLE_H_

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"

namespace fovea::store {

/// chunk_max_W of one level of one field of one step: the largest |coefficient| of each chunk.
/// Blocks are read as they are asked for, and kept. Thread-safe.
class ChunkTable {
 public:
  ChunkTable(FileSystem& files, std::string store_path, const std::string& field, int64_t step,
             const LevelLayout& layout);

  /// One block, [z][y][x] of layout.table_edge entries; empty if its file is not there, which is
  /// so where all its chunks are zero. DATA_LOSS if it is damaged. Stays where it is as long as
  /// the table lives. Adds the bytes that were read from its file, if any, to `bytes_read`.
  [[nodiscard]] StatusOr<const std::vector<float>*> Block(const Int3& block, uint64_t* bytes_read);
  /// Begins to read the block at 0, 0, 0, which most windows need. What goes wrong says Block.
  void StartFirstBlock();
  /// How many chunks of the level are stored; what cannot be read counts for nothing.
  [[nodiscard]] uint64_t StoredChunks();

  [[nodiscard]] Int3 BlockOf(const Int3& chunk) const;
  /// The place of a chunk in its block.
  [[nodiscard]] size_t IndexInBlock(const Int3& chunk) const;

 private:
  [[nodiscard]] StatusOr<ReadableFile> OpenBlock(const Int3& block) const;
  /// All that may be there.
  [[nodiscard]] std::vector<Int3> BlocksToCount() const;

  FileSystem& files_;
  std::string folder_;
  int64_t step_;
  LevelLayout layout_;
  std::mutex mutex_;
  std::map<std::array<int64_t, 3>, std::vector<float>> blocks_;  // guarded by mutex_
  std::optional<StatusOr<ReadableFile>> first_;                  // begun; guarded by mutex_
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_CHUNK_TABLE_H_
