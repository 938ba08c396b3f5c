#ifndef ENGINE_STORE_LAYOUT_H_
#define ENGINE_STORE_LAYOUT_H_

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/store/dataset.h"
#include "engine/store/stored_type.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

/// Which arrays a store holds and how they are cut: docs/formats/store.md in code.
namespace fovea::store {

inline constexpr int64_t kNoFrameNumber = std::numeric_limits<int64_t>::min();
inline constexpr int kSubBands = 7;
/// Chunks on each axis of a shard of detail, at most: an index is at most 8 KB.
inline constexpr int64_t kShardChunks = 8;
/// Steps in one chunk of time, frame_number and stats; of histogram. A commit rewrites one such
/// chunk of each, so they are small; opening a long series reads few of them.
inline constexpr int64_t kSeriesSteps = 1024;
inline constexpr int64_t kHistogramSteps = 16;
/// Steps that become visible together, at most.
inline constexpr int64_t kMostStepsAtOnce = 64;
/// Entries on each axis of a chunk of chunk_max_W, at most.
inline constexpr int64_t kTableEdge = 32;

/// How one level of detail is cut into chunks, shards of chunks, and blocks of chunk_max_W.
/// Positions and sizes are x, y, z.
struct LevelLayout {
  int level = 0;
  int64_t width = 0;  // W: voxels across the cell that these coefficients refine
  int64_t edge = 0;   // c: coefficients across a chunk
  Int3 dims;          // coefficients
  Int3 chunks;        // chunks that cover them
  Int3 shard_chunks;  // chunks in one shard
  Int3 shards;        // shards that cover the chunks
  Int3 table_edge;    // entries in one chunk of chunk_max_W
  Int3 tables;        // chunks of chunk_max_W
  Coding coding;      // of the coefficients

  [[nodiscard]] static LevelLayout Make(const DatasetInfo& info, const FieldInfo& field, int level);
  [[nodiscard]] int64_t ChunkValues() const { return kSubBands * edge * edge * edge; }
  [[nodiscard]] int64_t ChunkBytes() const { return ChunkValues() * BytesOfType(coding.type); }
  /// The coefficients of the chunk at `chunk`, cut off at the border.
  [[nodiscard]] Box3 ChunkBox(const Int3& chunk) const;
  [[nodiscard]] Int3 ShardOf(const Int3& chunk) const;
  /// The place of a chunk in the index of its shard: x fastest.
  [[nodiscard]] size_t IndexInShard(const Int3& chunk) const;
  /// The chunk at that place.
  [[nodiscard]] Int3 ChunkInShard(const Int3& shard, size_t place) const;
  /// The place of a chunk in its block of chunk_max_W: x fastest.
  [[nodiscard]] size_t IndexInTable(const Int3& chunk) const;
};

/// How LLL_0 is stored: of quantised coefficients, it alone is exact.
[[nodiscard]] Coding CoarseCoding(const DatasetInfo& info, const FieldInfo& field);
/// What coefficients of a field mean.
[[nodiscard]] Basis BasisOf(const DatasetInfo& info, const FieldInfo& field);

/// The array folders of a field, below the store.
[[nodiscard]] std::string CoarsePath(const std::string& field);
[[nodiscard]] std::string DetailPath(const std::string& field, int64_t width);
[[nodiscard]] std::string TablePath(const std::string& field, int64_t width);
[[nodiscard]] std::string StatsPath(const std::string& field);
[[nodiscard]] std::string HistogramPath(const std::string& field);
inline constexpr std::string_view kTimePath = "time";
inline constexpr std::string_view kFrameNumberPath = "frame_number";

/// Everything that is in an array's zarr.json, but how many steps it has.
struct ArraySpec {
  std::string path;                          // below the store
  std::string data_type;                     // float32 or 64, int16 to 64, uint16 to 64
  std::vector<int64_t> shape;                // without t
  std::vector<int64_t> chunk;                // with t; of what is encoded as one piece
  std::vector<int64_t> shard;                // with t; empty: chunks are files of their own
  std::vector<std::string> dimension_names;  // with t
  int64_t fill_value = 0;
  std::optional<Coding> coding = {};  // of coefficients, in Blosc chunks; without: in zstd frames

  /// Files of the array on each axis that hold anything, t excluded.
  [[nodiscard]] std::vector<int64_t> FileGrid() const;
  /// Steps in one file.
  [[nodiscard]] int64_t FileSteps() const { return shard.empty() ? chunk[0] : shard[0]; }
};

[[nodiscard]] std::vector<ArraySpec> AllArrays(const DatasetInfo& info);

/// The file name of a chunk or shard, "c.T.B.Z.Y.X": indices in the order of the dimensions.
[[nodiscard]] std::string ChunkName(const std::vector<int64_t>& indices);
/// The same for a position in space: [t, z, y, x], or [t, 0, z, y, x] for a shard of detail.
[[nodiscard]] std::string SpaceChunkName(int64_t step, const Int3& position, bool with_bands);
/// Reads such a name back; nothing if it is none, or not of so many indices.
[[nodiscard]] std::optional<std::vector<int64_t>> ParseChunkName(std::string_view name,
                                                                 size_t indices);

}  // namespace fovea::store

#endif  // ENGINE_STORE_LAYOUT_H_
