#include "engine/store/layout.h"

#include <algorithm>
#include <charconv>

#include <fmt/format.h>

namespace fovea::store {
namespace {

int64_t CeilDiv(int64_t a, int64_t b) {
  return (a + b - 1) / b;
}

/// Whole numbers, times a scale, as stores of this format version hold them.
Coding CodingOf(const DatasetInfo& info, const std::string& type, float scale) {
  return {type, scale, IsIntegerType(type) && info.format_version >= kFoldedVersion};
}

}  // namespace

LevelLayout LevelLayout::Make(const DatasetInfo& info, const FieldInfo& field, int level) {
  const Hierarchy& hierarchy = info.hierarchy;
  const int64_t chunk_edge = info.chunk_edge;
  LevelLayout layout;
  layout.coding = CodingOf(info, field.type,
                           field.scales.empty() ? 1 : field.scales[static_cast<size_t>(level)]);
  layout.level = level;
  layout.width = hierarchy.WidthAt(level);
  layout.edge = chunk_edge;
  layout.dims = hierarchy.DimsAt(level);
  for (int axis = 0; axis < 3; ++axis) {
    const int64_t chunks = CeilDiv(layout.dims[axis], chunk_edge);
    layout.chunks[axis] = chunks;
    layout.shard_chunks[axis] = std::min(chunks, kShardChunks);
    layout.shards[axis] = CeilDiv(chunks, layout.shard_chunks[axis]);
    layout.table_edge[axis] = std::min(chunks, kTableEdge);
    layout.tables[axis] = CeilDiv(chunks, layout.table_edge[axis]);
  }
  return layout;
}

Coding CoarseCoding(const DatasetInfo& info, const FieldInfo& field) {
  return field.scales.empty() ? CodingOf(info, field.type, 1) : Coding{};
}

Basis BasisOf(const DatasetInfo& info, const FieldInfo& field) {
  return {ParseWavelet(info.wavelet).value_or(Wavelet::kHaar),
          IsIntegerType(field.type) && field.scales.empty()};
}

Box3 LevelLayout::ChunkBox(const Int3& chunk) const {
  const Box3 cube{{chunk.x * edge, chunk.y * edge, chunk.z * edge},
                  {(chunk.x + 1) * edge, (chunk.y + 1) * edge, (chunk.z + 1) * edge}};
  return Intersect(cube, Box3::OfSize(dims));
}

Int3 LevelLayout::ShardOf(const Int3& chunk) const {
  return {chunk.x / shard_chunks.x, chunk.y / shard_chunks.y, chunk.z / shard_chunks.z};
}

size_t LevelLayout::IndexInShard(const Int3& chunk) const {
  return static_cast<size_t>(
      ((chunk.z % shard_chunks.z) * shard_chunks.y + chunk.y % shard_chunks.y) * shard_chunks.x +
      chunk.x % shard_chunks.x);
}

Int3 LevelLayout::ChunkInShard(const Int3& shard, size_t place) const {
  const Int3& size = shard_chunks;
  const auto i = static_cast<int64_t>(place);
  return {shard.x * size.x + i % size.x, shard.y * size.y + i / size.x % size.y,
          shard.z * size.z + i / (size.x * size.y)};
}

size_t LevelLayout::IndexInTable(const Int3& chunk) const {
  const Int3& size = table_edge;
  return static_cast<size_t>(((chunk.z % size.z) * size.y + chunk.y % size.y) * size.x +
                             chunk.x % size.x);
}

std::string CoarsePath(const std::string& field) {
  return field + "/coarse";
}
std::string DetailPath(const std::string& field, int64_t width) {
  return fmt::format("{}/detail_{}", field, width);
}
std::string TablePath(const std::string& field, int64_t width) {
  return fmt::format("{}/chunk_max_{}", field, width);
}
std::string StatsPath(const std::string& field) {
  return field + "/stats";
}
std::string HistogramPath(const std::string& field) {
  return field + "/histogram";
}

std::vector<int64_t> ArraySpec::FileGrid() const {
  const std::vector<int64_t>& file = shard.empty() ? chunk : shard;
  std::vector<int64_t> grid;
  for (size_t axis = 0; axis < shape.size(); ++axis) {
    grid.push_back(CeilDiv(shape[axis], file[axis + 1]));
  }
  return grid;
}

namespace {

/// Folded numbers are unsigned ones.
std::string DataTypeOf(const Coding& coding) {
  return (coding.is_folded ? "u" : "") + coding.type;
}

void AddLevel(const std::string& field, const LevelLayout& level, std::vector<ArraySpec>* arrays) {
  const int64_t c = level.edge;
  const Int3& per_shard = level.shard_chunks;
  arrays->push_back({DetailPath(field, level.width),
                     DataTypeOf(level.coding),
                     {kSubBands, level.dims.z, level.dims.y, level.dims.x},
                     {1, kSubBands, c, c, c},
                     {1, kSubBands, per_shard.z * c, per_shard.y * c, per_shard.x * c},
                     {"t", "band", "z", "y", "x"},
                     0,
                     level.coding});
  arrays->push_back({TablePath(field, level.width),
                     "float32",
                     {level.chunks.z, level.chunks.y, level.chunks.x},
                     {1, level.table_edge.z, level.table_edge.y, level.table_edge.x},
                     {},
                     {"t", "z", "y", "x"}});
}

}  // namespace

std::vector<ArraySpec> AllArrays(const DatasetInfo& info) {
  std::vector<ArraySpec> arrays;
  arrays.push_back({std::string(kTimePath), "int64", {}, {kSeriesSteps}, {}, {"t"}});
  arrays.push_back(
      {std::string(kFrameNumberPath), "int64", {}, {kSeriesSteps}, {}, {"t"}, kNoFrameNumber});
  const Int3 coarse = info.hierarchy.DimsAt(0);
  for (const FieldInfo& field : info.fields) {
    arrays.push_back({CoarsePath(field.name),
                      DataTypeOf(CoarseCoding(info, field)),
                      {coarse.z, coarse.y, coarse.x},
                      {1, coarse.z, coarse.y, coarse.x},
                      {},
                      {"t", "z", "y", "x"},
                      0,
                      CoarseCoding(info, field)});
    for (int level = 0; level < info.hierarchy.finest(); ++level) {
      AddLevel(field.name, LevelLayout::Make(info, field, level), &arrays);
    }
    arrays.push_back(
        {StatsPath(field.name), "float64", {2}, {kSeriesSteps, 2}, {}, {"t", "statistic"}});
    arrays.push_back(
        {HistogramPath(field.name), "uint64", {256}, {kHistogramSteps, 256}, {}, {"t", "bin"}});
  }
  return arrays;
}

std::string ChunkName(const std::vector<int64_t>& indices) {
  std::string name = "c";
  for (const int64_t index : indices) {
    name += fmt::format(".{}", index);
  }
  return name;
}

std::string SpaceChunkName(int64_t step, const Int3& position, bool with_bands) {
  return with_bands ? ChunkName({step, 0, position.z, position.y, position.x})
                    : ChunkName({step, position.z, position.y, position.x});
}

std::optional<std::vector<int64_t>> ParseChunkName(std::string_view name, size_t indices) {
  if (!name.starts_with('c')) {
    return std::nullopt;
  }
  name.remove_prefix(1);
  std::vector<int64_t> parsed;
  while (name.starts_with('.') && parsed.size() < indices) {
    int64_t index = 0;
    const auto [end, error] = std::from_chars(name.data() + 1, name.data() + name.size(), index);
    if (error != std::errc() || index < 0) {
      return std::nullopt;
    }
    parsed.push_back(index);
    name.remove_prefix(static_cast<size_t>(end - name.data()));
  }
  if (!name.empty() || parsed.size() != indices) {
    return std::nullopt;
  }
  return parsed;
}

}  // namespace fovea::store
