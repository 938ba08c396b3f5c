#ifndef ENGINE_STORE_LEVEL_WRITER_H_
#define ENGINE_STORE_LEVEL_WRITER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/chunk_file.h"
#include "engine/store/encoder_pool.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"

namespace fovea::store {

/// Writes one level of detail of one field of one step, one layer of chunks (one z) after another:
/// its shards, and its table of the largest |coefficient| of each chunk. Chunks of zeros, and
/// shards of such, are not stored. What is in memory is one layer, encoded; no file stays open
/// between layers. The files appear with the batch, and are the same whatever the threads.
class LevelWriter {
 public:
  /// `encoders` and `batch` must outlive it.
  LevelWriter(const std::string& store_path, const std::string& field, int64_t step,
              LevelLayout layout, EncoderPool* encoders, FileBatch* batch);

  [[nodiscard]] const LevelLayout& layout() const { return layout_; }
  /// Encodes a chunk of the layer in hand: `stored` as the level's type has it, zeros past the
  /// border; `largest` of its magnitudes, above 0. Thread-safe. INVALID_ARGUMENT if `largest` is
  /// not finite.
  [[nodiscard]] Status Add(const Int3& chunk, std::span<const std::byte> stored, float largest);
  /// Writes what was added, all of it at this z; ascending. Layers without chunks may be left out.
  [[nodiscard]] Status EndLayer(int64_t z);
  /// The last call: the shards that are not finished, and the table.
  [[nodiscard]] Status Finish();

 private:
  struct Chunk {
    Int3 at;
    std::vector<std::byte> encoded;
  };
  using Position = std::array<int64_t, 2>;  // y, x of a shard

  [[nodiscard]] Status WriteShard(const std::vector<const Chunk*>& chunks, bool is_complete,
                                  ShardWriter* shard);
  [[nodiscard]] Status FinishShards();
  void SetLargest(const Int3& chunk, float largest);
  [[nodiscard]] Status WriteTable();

  std::string folder_, table_folder_;
  int64_t step_;
  LevelLayout layout_;
  EncoderPool* encoders_;
  FileBatch* batch_;
  std::mutex mutex_;
  std::vector<Chunk> layer_;  // guarded by mutex_
  int64_t row_ = 0;           // z of the shards in hand
  std::map<Position, ShardWriter> shards_;
  /// Blocks of the table by z, y, x; only those that hold anything. Guarded by mutex_.
  std::map<std::array<int64_t, 3>, std::vector<float>> table_;
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_LEVEL_WRITER_H_
