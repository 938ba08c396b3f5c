#ifndef ENGINE_STORE_CHUNK_FILE_H_
#define ENGINE_STORE_CHUNK_FILE_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/codec.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"

/// Chunks in files: one chunk alone, and many in a shard with an index at its end.
namespace fovea::store {

/// Reads the one chunk of a file into `raw`. NOT_FOUND if there is no file; DATA_LOSS naming it if
/// a checksum or a length does not fit. Returns the bytes read.
[[nodiscard]] StatusOr<int64_t> ReadChunkFile(FileSystem& files, const std::string& path,
                                              std::span<std::byte> raw);
[[nodiscard]] StatusOr<int64_t> ReadChunkFile(const ReadableFile& file, std::span<std::byte> raw);

/// The same for coefficients.
[[nodiscard]] StatusOr<int64_t> ReadValuesFile(FileSystem& files, const std::string& path,
                                               const Coding& coding, std::span<float> values);

/// Where a chunk lies in its shard.
struct ShardEntry {
  uint64_t offset = 0;
  uint64_t bytes = 0;
};

/// One entry a chunk of the shard, in the order of LevelLayout::IndexInShard; nothing where the
/// chunk is not stored.
using ShardIndex = std::vector<std::optional<ShardEntry>>;

/// The bytes of the index of a shard of `chunks` chunks, its checksum included.
[[nodiscard]] int64_t ShardIndexBytes(size_t chunks);

/// Begins to read the index of a shard of `chunks` chunks.
void StartShardIndex(const ReadableFile& file, size_t chunks);

/// Reads and checks the index. DATA_LOSS, naming the file, if its checksum does not fit or an
/// entry points outside the file or is longer than `max_chunk_bytes`.
[[nodiscard]] StatusOr<ShardIndex> ReadShardIndex(const ReadableFile& file, size_t chunks,
                                                  int64_t max_chunk_bytes);

/// Writes one shard, chunk after chunk. Its file is open from an Append to Close or Finish only.
class ShardWriter {
 public:
  /// Adds the file `path` to `batch`. It will hold `chunks` chunks, or fewer.
  [[nodiscard]] static StatusOr<ShardWriter> Start(FileBatch* batch, const std::string& path,
                                                   size_t chunks);
  [[nodiscard]] Status Append(size_t place, std::span<const std::byte> encoded);
  /// Gives the file back to the system until the next Append.
  void Close() { file_.Close(); }
  /// Writes the index, once; nothing can follow.
  [[nodiscard]] Status Finish();

 private:
  ShardWriter(WritableFile file, size_t chunks) : file_(std::move(file)), index_(chunks) {}

  WritableFile file_;
  ShardIndex index_;
  bool is_finished_ = false;
};

/// The values of one chunk of a small array with steps along its first axis: time, stats ...
template <typename T>
struct SeriesChunk {
  int64_t steps = 0;      // rows in it
  int64_t width = 1;      // values in a row
  std::vector<T> values;  // steps * width

  SeriesChunk(int64_t steps_in_chunk, int64_t values_in_row, T fill)
      : steps(steps_in_chunk),
        width(values_in_row),
        values(static_cast<size_t>(steps_in_chunk * values_in_row), fill) {}
  /// The row of `step` in the chunk that holds it.
  [[nodiscard]] std::span<T> Row(int64_t step) {
    return std::span(values).subspan(static_cast<size_t>(step % steps * width),
                                     static_cast<size_t>(width));
  }
  [[nodiscard]] std::span<std::byte> Bytes() { return std::as_writable_bytes(std::span(values)); }
};

/// The file that holds the row of `step`, `steps` rows a file.
[[nodiscard]] std::string SeriesPath(const std::string& store_path, const std::string& array,
                                     int64_t step, int64_t steps, bool has_rows);

/// Reads the chunk that holds the row of `step`, in an array of rows of `width` values (0: the
/// array has no second axis). A missing file is DATA_LOSS: every committed step has its row.
template <typename T>
[[nodiscard]] StatusOr<SeriesChunk<T>> ReadSeries(FileSystem& files, const std::string& store_path,
                                                  const std::string& array, int64_t step,
                                                  int64_t steps, int64_t width) {
  SeriesChunk<T> chunk(steps, width == 0 ? 1 : width, T{});
  const std::string path = SeriesPath(store_path, array, step, steps, width != 0);
  const StatusOr<int64_t> read = ReadChunkFile(files, path, chunk.Bytes());
  if (absl::IsNotFound(read.status())) {
    return DataLoss("{} is missing", path);
  }
  FOVEA_RETURN_IF_ERROR(read.status());
  return chunk;
}

}  // namespace fovea::store

#endif  // ENGINE_STORE_CHUNK_FILE_H_
