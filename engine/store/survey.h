#ifndef ENGINE_STORE_SURVEY_H_
#define ENGINE_STORE_SURVEY_H_

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"
#include "engine/store/layout.h"

/// Reading every coefficient of a store, checking all that can be checked: what verify and repair
/// begin with.
namespace fovea::store {

/// A place in a grid of chunks, shards or blocks: z, y, x, in the order of files.
using Position = std::array<int64_t, 3>;

struct FoundChunk {
  Int3 at;
  ShardEntry entry;
  Status status;      // of its bytes; a value that is not finite is DATA_LOSS
  float largest = 0;  // |coefficient|
};

struct FoundShard {
  Int3 shard;
  std::string path;
  Status status;  // of the file and its index: if not OK there are no chunks
  int64_t file_bytes = 0;
  std::vector<FoundChunk> chunks;  // those that the index has, in its order
};

/// The largest |coefficient| of an encoded chunk; `values` has room for it. DATA_LOSS if it is
/// damaged or a value is not finite.
[[nodiscard]] StatusOr<float> LargestOfChunk(std::span<const std::byte> encoded,
                                             const LevelLayout& layout, Decoder* decoder,
                                             std::vector<float>* values);

/// One level of detail of one field of one step.
struct FoundLevel {
  LevelLayout layout;
  /// chunk_max_W, block by block, as far as it could be read; blocks of zeros are not stored.
  std::map<Position, std::vector<float>> table;
  std::map<Position, Status> damaged_blocks;
  std::vector<Int3> shards;  // there are files of

  /// What the table says of a chunk; 0 if its block is not there.
  [[nodiscard]] float Largest(const Int3& chunk) const;
  [[nodiscard]] Position BlockOf(const Int3& chunk) const;
  /// Sets what the table says of a chunk to 0.
  void Forget(const Int3& chunk);
  /// The chunks of which the table says that they are not 0.
  [[nodiscard]] std::vector<Int3> Chunks() const;
};

/// One field of one step.
struct FoundStep {
  int64_t step = 0;
  std::string field;
  std::string coarse_path;
  bool lost = false;               // it is marked so: nothing should be there
  Status coarse;                   // NOT_FOUND if there is no file
  uint64_t chunks = 0, bytes = 0;  // of coarse and the tables, that were sound
  std::vector<FoundLevel> levels;
};

/// Is told what is found, in the order of steps, fields, levels and shards. One call at a time.
class SurveyVisitor {
 public:
  virtual ~SurveyVisitor() = default;
  /// The coarse level and the tables of a step's field were read.
  virtual void OnStep(FoundStep& found) = 0;
  virtual void OnShard(FoundStep& found, FoundLevel& level, FoundShard& shard) = 0;
  /// Every shard of the level was there.
  virtual void OnLevelEnd(FoundStep& found, FoundLevel& level) = 0;
};

/// Reads with `threads` threads (0: all), holding a bounded number of shards' findings, and of
/// each thread one chunk. Not thread-safe.
class Survey {
 public:
  Survey(FileSystem& files, std::string store_path, DatasetInfo info, int threads);

  /// Lists the files of an array, once. Names of committed steps that lie outside the array come
  /// back in `stray`, with their path.
  [[nodiscard]] Status List(const ArraySpec& array, std::vector<std::string>* stray);
  /// The steps that any listed file belongs to.
  [[nodiscard]] int64_t steps_with_files() const { return steps_with_files_; }
  /// All fields of steps first to end - 1.
  void Read(int64_t first, int64_t end, SurveyVisitor* visitor);
  /// How many steps from `first` on are worth reading at once.
  [[nodiscard]] int64_t StepsAtOnce(int64_t first) const;

 private:
  using Indices = std::vector<int64_t>;
  struct ShardTask {
    const FoundStep* step;
    const FoundLevel* level;
    FoundShard found;
  };

  [[nodiscard]] const std::vector<Indices>& FilesOf(const std::string& array, int64_t step) const;
  void ReadStep(FoundStep* found) const;
  void ReadTable(const std::string& field, int64_t step, FoundLevel* level, FoundStep* found) const;
  void ReadIndex(ShardTask* task) const;
  void ReadChunks(const ShardTask& task, std::span<FoundChunk> chunks) const;
  void ReadShards(std::span<ShardTask> tasks) const;

  FileSystem& files_;
  const std::string path_;
  const DatasetInfo info_;
  const int threads_;
  /// By array, by index along t: the other indices of each file.
  std::map<std::string, std::map<int64_t, std::vector<Indices>>> listed_;
  int64_t steps_with_files_ = 0;
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_SURVEY_H_
