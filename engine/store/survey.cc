#include "engine/store/survey.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <span>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/store/file.h"

namespace fovea::store {
namespace {

/// Shards whose findings are held at once; steps that are read at once.
constexpr size_t kShardsAtOnce = 128;
constexpr int64_t kStepsAtOnce = 64;
/// Chunks that one thread reads in one go.
constexpr size_t kChunksAtOnce = 16;

/// Reads and decodes one chunk; its largest |coefficient|.
StatusOr<float> LargestOf(const ReadableFile& file, const ShardEntry& entry,
                          const LevelLayout& layout, Decoder* decoder, std::vector<float>* values) {
  std::vector<std::byte> bytes(entry.bytes);
  FOVEA_RETURN_IF_ERROR(file.ReadAt(static_cast<int64_t>(entry.offset), bytes));
  return LargestOfChunk(bytes, layout, decoder, values);
}

}  // namespace

StatusOr<float> LargestOfChunk(std::span<const std::byte> encoded, const LevelLayout& layout,
                               Decoder* decoder, std::vector<float>* values) {
  FOVEA_RETURN_IF_ERROR(decoder->DecodeValues(encoded, layout.coding, *values));
  const float largest = LargestMagnitude(*values);
  return std::isfinite(largest) ? StatusOr<float>(largest)
                                : DataLoss("a coefficient is not finite");
}

Position FoundLevel::BlockOf(const Int3& chunk) const {
  const Int3& edge = layout.table_edge;
  return {chunk.z / edge.z, chunk.y / edge.y, chunk.x / edge.x};
}

float FoundLevel::Largest(const Int3& chunk) const {
  const auto block = table.find(BlockOf(chunk));
  return block == table.end() ? 0.0F : block->second[layout.IndexInTable(chunk)];
}

void FoundLevel::Forget(const Int3& chunk) {
  if (const auto block = table.find(BlockOf(chunk)); block != table.end()) {
    block->second[layout.IndexInTable(chunk)] = 0;
  }
}

std::vector<Int3> FoundLevel::Chunks() const {
  std::vector<Int3> chunks;
  const Int3& edge = layout.table_edge;
  for (const auto& [block, values] : table) {
    for (size_t place = 0; place < values.size(); ++place) {
      const auto i = static_cast<int64_t>(place);
      if (values[place] != 0) {
        chunks.push_back({block[2] * edge.x + i % edge.x, block[1] * edge.y + i / edge.x % edge.y,
                          block[0] * edge.z + i / (edge.x * edge.y)});
      }
    }
  }
  return chunks;
}

Survey::Survey(FileSystem& files, std::string store_path, DatasetInfo info, int threads)
    : files_(files), path_(std::move(store_path)), info_(std::move(info)), threads_(threads) {}

Status Survey::List(const ArraySpec& array, std::vector<std::string>* stray) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> names,
                         ListDirectory(files_, path_ + "/" + array.path));
  const std::vector<int64_t> grid = array.FileGrid();
  const int64_t files = (info_.committed_steps + array.FileSteps() - 1) / array.FileSteps();
  for (const std::string& name : names) {
    const std::optional<Indices> indices = ParseChunkName(name, grid.size() + 1);
    if (!indices || indices->front() >= files) {
      continue;  // metadata, temporary files, a step that is not committed
    }
    steps_with_files_ = std::max(steps_with_files_, (indices->front() + 1) * array.FileSteps());
    Indices rest(indices->begin() + 1, indices->end());
    if (std::equal(rest.begin(), rest.end(), grid.begin(), std::less<>())) {
      listed_[array.path][indices->front()].push_back(std::move(rest));
    } else {
      stray->push_back(fmt::format("{}/{}/{}", path_, array.path, name));
    }
  }
  for (auto& [time, rests] : listed_[array.path]) {
    std::sort(rests.begin(), rests.end());
  }
  return absl::OkStatus();
}

const std::vector<Survey::Indices>& Survey::FilesOf(const std::string& array, int64_t step) const {
  static const std::vector<Indices> kNone;
  const auto by_time = listed_.find(array);
  if (by_time == listed_.end()) {
    return kNone;
  }
  const auto found = by_time->second.find(step);
  return found == by_time->second.end() ? kNone : found->second;
}

int64_t Survey::StepsAtOnce(int64_t first) const {
  size_t shards = 0;
  int64_t end = first;
  while (end < first + kStepsAtOnce && shards < kShardsAtOnce) {
    for (const FieldInfo& field : info_.fields) {
      for (int level = 0; level < info_.hierarchy.finest(); ++level) {
        shards += FilesOf(DetailPath(field.name, info_.hierarchy.WidthAt(level)), end).size();
      }
    }
    ++end;
  }
  return end - first;
}

void Survey::ReadTable(const std::string& field, int64_t step, FoundLevel* level,
                       FoundStep* found) const {
  const LevelLayout& layout = level->layout;
  const std::string folder = TablePath(field, layout.width);
  for (const Indices& at : FilesOf(folder, step)) {
    std::vector<float> values(static_cast<size_t>(layout.table_edge.Product()));
    const std::string path =
        fmt::format("{}/{}/{}", path_, folder,
                    SpaceChunkName(step, {at[2], at[1], at[0]}, /*with_bands=*/false));
    const StatusOr<int64_t> read =
        ReadChunkFile(files_, path, std::as_writable_bytes(std::span(values)));
    const Position position{at[0], at[1], at[2]};
    if (!read.ok()) {
      level->damaged_blocks[position] = read.status();
      continue;
    }
    ++found->chunks;
    found->bytes += static_cast<uint64_t>(*read);
    level->table[position] = std::move(values);
  }
}

void Survey::ReadStep(FoundStep* found) const {
  const FieldInfo& field = info_.FieldOf(found->field);
  std::vector<float> coarse(static_cast<size_t>(info_.hierarchy.DimsAt(0).Product()));
  found->coarse_path = fmt::format("{}/{}/{}", path_, CoarsePath(found->field),
                                   SpaceChunkName(found->step, {0, 0, 0}, /*with_bands=*/false));
  const StatusOr<int64_t> read =
      ReadValuesFile(files_, found->coarse_path, CoarseCoding(info_, field), coarse);
  found->coarse = read.status();
  if (read.ok()) {
    ++found->chunks;
    found->bytes += static_cast<uint64_t>(*read);
  }
  for (int at = 0; at < info_.hierarchy.finest(); ++at) {
    FoundLevel& level = found->levels.emplace_back();
    level.layout = LevelLayout::Make(info_, field, at);
    ReadTable(found->field, found->step, &level, found);
    for (const Indices& file : FilesOf(DetailPath(found->field, level.layout.width), found->step)) {
      level.shards.push_back({file[3], file[2], file[1]});
    }
  }
}

void Survey::ReadIndex(ShardTask* task) const {
  FoundShard& found = task->found;
  const LevelLayout& layout = task->level->layout;
  const Int3& size = layout.shard_chunks;
  const auto places = static_cast<size_t>(size.Product());
  const StatusOr<ReadableFile> file = ReadableFile::Open(files_, found.path);
  const StatusOr<ShardIndex> index =
      file.ok() ? ReadShardIndex(*file, places, MaxEncodedBytes(layout.ChunkBytes()))
                : StatusOr<ShardIndex>(file.status());
  found.file_bytes = file.ok() ? file->size() : 0;
  found.status = index.status();
  for (size_t place = 0; index.ok() && place < places; ++place) {
    if (const std::optional<ShardEntry>& entry = (*index)[place]) {
      found.chunks.push_back({layout.ChunkInShard(found.shard, place), *entry, {}, 0});
    }
  }
}

void Survey::ReadChunks(const ShardTask& task, std::span<FoundChunk> chunks) const {
  const LevelLayout& layout = task.level->layout;
  const StatusOr<ReadableFile> file = ReadableFile::Open(files_, task.found.path);
  Decoder decoder;
  std::vector<float> values(static_cast<size_t>(layout.ChunkValues()));
  for (FoundChunk& chunk : chunks) {
    const StatusOr<float> largest = file.ok()
                                        ? LargestOf(*file, chunk.entry, layout, &decoder, &values)
                                        : StatusOr<float>(file.status());
    chunk.status = largest.status();
    chunk.largest = largest.ok() ? *largest : 0;
  }
}

void Survey::ReadShards(std::span<ShardTask> tasks) const {
  ParallelFor(0, std::ssize(tasks), 1, threads_, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      ReadIndex(&tasks[static_cast<size_t>(i)]);
    }
  });
  std::vector<std::pair<const ShardTask*, std::span<FoundChunk>>> runs;
  for (ShardTask& task : tasks) {
    const std::span<FoundChunk> chunks(task.found.chunks);
    for (size_t first = 0; first < chunks.size(); first += kChunksAtOnce) {
      runs.emplace_back(&task,
                        chunks.subspan(first, std::min(kChunksAtOnce, chunks.size() - first)));
    }
  }
  ParallelFor(0, std::ssize(runs), 1, threads_, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const auto& [task, chunks] = runs[static_cast<size_t>(i)];
      ReadChunks(*task, chunks);
    }
  });
}

void Survey::Read(int64_t first, int64_t end, SurveyVisitor* visitor) {
  std::vector<FoundStep> steps;
  for (int64_t step = first; step < end; ++step) {
    for (const FieldInfo& field : info_.fields) {
      const bool lost = std::binary_search(field.lost_steps.begin(), field.lost_steps.end(), step);
      steps.push_back({step, field.name, "", lost, {}, 0, 0, {}});
    }
  }
  ParallelFor(0, std::ssize(steps), 1, threads_, [&](int64_t from, int64_t to) {
    for (int64_t i = from; i < to; ++i) {
      ReadStep(&steps[static_cast<size_t>(i)]);
    }
  });
  std::vector<ShardTask> tasks;
  for (const FoundStep& step : steps) {
    for (const FoundLevel& level : step.levels) {
      for (const Int3& shard : level.shards) {
        const std::string path =
            fmt::format("{}/{}/{}", path_, DetailPath(step.field, level.layout.width),
                        SpaceChunkName(step.step, shard, /*with_bands=*/true));
        tasks.push_back({&step, &level, {shard, path, {}, 0, {}}});
      }
    }
  }
  size_t next = 0;  // task
  size_t read = 0;  // tasks before this one
  for (FoundStep& step : steps) {
    visitor->OnStep(step);
    for (FoundLevel& level : step.levels) {
      for (size_t i = 0; i < level.shards.size(); ++i, ++next) {
        if (next == read) {
          read = std::min(tasks.size(), next + kShardsAtOnce);
          ReadShards(std::span(tasks).subspan(next, read - next));
        }
        visitor->OnShard(step, level, tasks[next].found);
        tasks[next].found = {};
      }
      visitor->OnLevelEnd(step, level);
    }
  }
}

}  // namespace fovea::store
