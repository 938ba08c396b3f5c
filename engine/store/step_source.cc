#include "engine/store/step_source.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/store/chunk_file.h"
#include "engine/store/chunk_table.h"
#include "engine/store/codec.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/read_quote.h"
#include "engine/store/retention.h"

// A window read: (1) which chunks meet the window; (2) the tables chunk_max_W say which of them
// are zero, and which must be there; (3) the indices of their shards say where they lie; (4) runs
// of neighbouring chunks are read at once, checked, decoded and copied, runs in parallel. All that
// a step of these reads is asked of the device before the first is waited for.

namespace fovea::store {
namespace {

/// Chunks that lie closer than this are read at once; a run holds at most so many.
constexpr uint64_t kMaxGapBytes = 4096;
constexpr size_t kMaxRunChunks = 16;

/// What the table of a level says about a chunk.
enum class Stored { kNo, kYes, kUnknown };

struct Wanted {
  Int3 chunk;
  Stored stored = Stored::kUnknown;
  ShardEntry entry;
};

/// Neighbouring chunks of one shard, by offset. They are read from the very file whose index said
/// where they lie: another may have taken its name since.
struct Run {
  std::shared_ptr<const ReadableFile> file;
  std::vector<Wanted> chunks;
};

/// A shard, open, what is wanted of it, and its index.
struct Shard {
  std::string path;
  std::vector<Wanted> wanted;
  Status status;                             // of opening it; OK if there is none
  std::shared_ptr<const ReadableFile> file;  // null if there is no such shard
  ShardIndex index;
};

/// Files that one window read keeps open at a time, at most.
constexpr size_t kMaxOpenShards = 16;

/// One ReadDetail call.
struct Window {
  const LevelLayout& layout;
  ChunkTable& table;
  const Box3& box;
  std::span<float> out;
};

class StoredStep final : public StepSource {
 public:
  StoredStep(FileSystem& files, std::string store_path, DatasetInfo info, int64_t step,
             std::string field, OnDamage on_damage)
      : files_(files),
        path_(std::move(store_path)),
        info_(std::move(info)),
        step_(step),
        field_(std::move(field)),
        on_damage_(on_damage),
        coarse_coding_(CoarseCoding(info_, info_.FieldOf(field_))),
        basis_(BasisOf(info_, info_.FieldOf(field_))),
        retention_(files, path_, info_) {
    for (int level = 0; level < info_.hierarchy.finest(); ++level) {
      layouts_.push_back(LevelLayout::Make(info_, info_.FieldOf(field_), level));
      tables_.push_back(
          std::make_unique<ChunkTable>(files_, path_, field_, step_, layouts_.back()));
    }
  }

  [[nodiscard]] const Hierarchy& hierarchy() const override { return info_.hierarchy; }
  [[nodiscard]] Basis basis() const override { return basis_; }
  [[nodiscard]] Status ReadCoarse(std::span<float> out) override;
  [[nodiscard]] Status ReadDetail(int level, const Box3& window, std::span<float> out) override;
  [[nodiscard]] ReadStats read_stats() const override;
  /// Counts as if the coarse level and the windows had been read, for read_stats.
  [[nodiscard]] Status CountReads(const RetainedSet& retained);

 private:
  /// Blocks of the table that one window read has asked for; null: nothing is known of them.
  using Blocks = std::map<std::array<int64_t, 3>, const std::vector<float>*>;
  using WantedOfShards = std::map<std::array<int64_t, 3>, std::vector<Wanted>>;  // by {z, y, x}

  [[nodiscard]] StatusOr<Stored> IsStored(const Window& window, const Int3& chunk, Blocks* blocks);
  [[nodiscard]] Status FindWanted(const Window& window, WantedOfShards* shards);
  /// Opens a shard and begins to read its index.
  [[nodiscard]] Shard Open(const Window& window, std::vector<Wanted> wanted);
  [[nodiscard]] Status ReadIndex(const Window& window, Shard* shard);
  [[nodiscard]] Status PlanShard(const Window& window, Shard shard, std::vector<Run>* runs);
  /// Steps 1 to 3, some shards at a time: `take` is given the runs that the window is read in.
  [[nodiscard]] Status PlanRuns(const Window& window,
                                const std::function<Status(const std::vector<Run>&)>& take);
  [[nodiscard]] Status ReadRun(const Window& window, const Run& run);
  [[nodiscard]] Status ReadRuns(const Window& window, const std::vector<Run>& runs);
  /// One chunk cannot be had because of `why`: an error, or zeros and a count.
  [[nodiscard]] Status Damaged(const LevelLayout& layout, const Int3& chunk, const Status& why);
  void CountDamaged(const std::array<int64_t, 4>& chunk);
  /// A step marked as lost: an error, or zeros and a count.
  [[nodiscard]] Status LostStep();
  [[nodiscard]] std::string CoarseFile() const;

  FileSystem& files_;
  const std::string path_;
  const DatasetInfo info_;
  const int64_t step_;
  const std::string field_;
  const OnDamage on_damage_;
  const Coding coarse_coding_;
  const Basis basis_;
  std::vector<LevelLayout> layouts_;
  std::vector<std::unique_ptr<ChunkTable>> tables_;
  NewestRetention retention_;
  std::atomic<uint64_t> chunks_read_{0};
  std::atomic<uint64_t> bytes_read_{0};
  mutable std::mutex damaged_mutex_;
  std::set<std::array<int64_t, 4>> damaged_;  // level (tables: -2 - level), z, y, x
  std::atomic<int64_t> decode_ns_{0};
};

ReadStats StoredStep::read_stats() const {
  ReadStats stats;
  stats.chunks_read = chunks_read_;
  stats.bytes_read = bytes_read_;
  {
    const std::lock_guard lock(damaged_mutex_);
    stats.chunks_damaged = damaged_.size();
  }
  stats.decode_ms = static_cast<double>(decode_ns_) / 1e6;
  stats.chunks_total = 1;  // coarse
  for (const auto& table : tables_) {
    stats.chunks_total += table->StoredChunks();
  }
  return stats;
}

std::string StoredStep::CoarseFile() const {
  return fmt::format("{}/{}/{}", path_, CoarsePath(field_),
                     SpaceChunkName(step_, {0, 0, 0}, /*with_bands=*/false));
}

Status StoredStep::ReadCoarse(std::span<float> out) {
  const auto values = static_cast<size_t>(info_.hierarchy.DimsAt(0).Product());
  if (out.size() != values) {
    return Internal("ReadCoarse into {} values, the coarse level has {}", out.size(), values);
  }
  if (info_.IsLost(field_, step_)) {
    FOVEA_RETURN_IF_ERROR(LostStep());
    std::fill(out.begin(), out.end(), 0.0F);
    return absl::OkStatus();
  }
  for (const auto& table : tables_) {
    table->StartFirstBlock();
  }
  const std::string file = CoarseFile();
  const StatusOr<int64_t> read = ReadValuesFile(files_, file, coarse_coding_, out);
  if (!read.ok()) {
    const std::string where = fmt::format("coarse level of field '{}', step {}", field_, step_);
    return absl::IsNotFound(read.status()) ? DataLoss("{}: {} is missing", where, file)
                                           : Annotate(read.status(), where);
  }
  bytes_read_ += static_cast<uint64_t>(*read);
  ++chunks_read_;
  return absl::OkStatus();
}

void StoredStep::CountDamaged(const std::array<int64_t, 4>& chunk) {
  const std::lock_guard lock(damaged_mutex_);
  damaged_.insert(chunk);
}

Status StoredStep::LostStep() {
  if (on_damage_ == OnDamage::kCount) {
    CountDamaged({-1, 0, 0, 0});
    return absl::OkStatus();
  }
  return DataLoss("step {} of field '{}' of {} was lost; all that is left of it is its number",
                  step_, field_, path_);
}

Status StoredStep::Damaged(const LevelLayout& layout, const Int3& chunk, const Status& why) {
  if (!absl::IsDataLoss(why)) {
    return why;  // out of descriptors, no permission: nothing is known about the data
  }
  if (on_damage_ == OnDamage::kCount) {
    CountDamaged({layout.level, chunk.z, chunk.y, chunk.x});
    return absl::OkStatus();
  }
  return Annotate(why, fmt::format("chunk {},{},{} (x, y, z) of detail_{} of field '{}', step {}",
                                   chunk.x, chunk.y, chunk.z, layout.width, field_, step_));
}

StatusOr<Stored> StoredStep::IsStored(const Window& window, const Int3& chunk, Blocks* blocks) {
  const Int3 at = window.table.BlockOf(chunk);
  const auto [block, is_new] = blocks->try_emplace({at.z, at.y, at.x}, nullptr);
  if (is_new) {
    uint64_t bytes = 0;
    const StatusOr<const std::vector<float>*> read = window.table.Block(at, &bytes);
    bytes_read_ += bytes;
    if (absl::IsDataLoss(read.status()) && on_damage_ == OnDamage::kCount) {
      // One piece, however many of its chunks are asked for; they are looked for in their shards.
      CountDamaged({-2 - window.layout.level, at.z, at.y, at.x});
    } else if (!read.ok()) {
      FOVEA_RETURN_IF_ERROR(Damaged(window.layout, chunk, read.status()));
    } else if (!(*read)->empty()) {
      block->second = *read;
    }
  }
  if (block->second == nullptr) {
    return Stored::kUnknown;
  }
  return (*block->second)[window.table.IndexInBlock(chunk)] > 0 ? Stored::kYes : Stored::kNo;
}

Status StoredStep::FindWanted(const Window& window, WantedOfShards* shards) {
  const LevelLayout& layout = window.layout;
  const int64_t c = layout.edge;
  Blocks blocks;
  for (int64_t z = window.box.lo.z / c; z * c < window.box.hi.z; ++z) {
    for (int64_t y = window.box.lo.y / c; y * c < window.box.hi.y; ++y) {
      for (int64_t x = window.box.lo.x / c; x * c < window.box.hi.x; ++x) {
        FOVEA_ASSIGN_OR_RETURN(const Stored stored, IsStored(window, {x, y, z}, &blocks));
        if (stored != Stored::kNo) {
          const Int3 shard = layout.ShardOf({x, y, z});
          (*shards)[{shard.z, shard.y, shard.x}].push_back({{x, y, z}, stored, {}});
        }
      }
    }
  }
  return absl::OkStatus();
}

Shard StoredStep::Open(const Window& window, std::vector<Wanted> wanted) {
  const LevelLayout& layout = window.layout;
  Shard shard;
  shard.path =
      fmt::format("{}/{}/{}", path_, DetailPath(field_, layout.width),
                  SpaceChunkName(step_, layout.ShardOf(wanted.front().chunk), /*with_bands=*/true));
  shard.wanted = std::move(wanted);
  StatusOr<ReadableFile> file = ReadableFile::Open(files_, shard.path);
  if (file.ok()) {
    StartShardIndex(*file, static_cast<size_t>(layout.shard_chunks.Product()));
    shard.file = std::make_shared<const ReadableFile>(*std::move(file));
  } else if (!absl::IsNotFound(file.status())) {
    shard.status = file.status();
  }
  return shard;
}

Status StoredStep::ReadIndex(const Window& window, Shard* shard) {
  if (shard->file == nullptr) {
    return shard->status;
  }
  const auto chunks = static_cast<size_t>(window.layout.shard_chunks.Product());
  bytes_read_ += static_cast<uint64_t>(ShardIndexBytes(chunks));
  FOVEA_ASSIGN_OR_RETURN(shard->index, ReadShardIndex(*shard->file, chunks,
                                                      MaxEncodedBytes(window.layout.ChunkBytes())));
  return absl::OkStatus();
}

Status StoredStep::PlanShard(const Window& window, Shard shard, std::vector<Run>* runs) {
  const LevelLayout& layout = window.layout;
  const Status status = ReadIndex(window, &shard);
  std::vector<Wanted> found;
  for (Wanted& one : shard.wanted) {
    const size_t place = layout.IndexInShard(one.chunk);
    if (!status.ok()) {
      FOVEA_RETURN_IF_ERROR(Damaged(layout, one.chunk, status));
    } else if (shard.file != nullptr && shard.index[place]) {
      one.entry = *shard.index[place];
      found.push_back(one);
    } else if (one.stored == Stored::kYes && !retention_.WasDropped(layout.level, one.chunk)) {
      FOVEA_RETURN_IF_ERROR(
          Damaged(layout, one.chunk, DataLoss("{} does not hold it, and should", shard.path)));
    }
  }
  std::sort(found.begin(), found.end(),
            [](const Wanted& a, const Wanted& b) { return a.entry.offset < b.entry.offset; });
  uint64_t end = 0;
  bool new_run = true;
  for (const Wanted& one : found) {
    if (new_run || runs->back().chunks.size() >= kMaxRunChunks || one.entry.offset < end ||
        one.entry.offset - end > kMaxGapBytes) {
      runs->push_back({shard.file, {}});
      new_run = false;
    }
    runs->back().chunks.push_back(one);
    end = one.entry.offset + one.entry.bytes;
  }
  return absl::OkStatus();
}

void CopyIntoWindow(const Window& window, const Int3& chunk, std::span<const float> values) {
  const int64_t edge = window.layout.edge;
  const Box3 part = Intersect(window.layout.ChunkBox(chunk), window.box);
  const Int3 size = window.box.Size();
  for (int64_t band = 0; band < kSubBands; ++band) {
    for (int64_t z = part.lo.z; z < part.hi.z; ++z) {
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const int64_t from =
            ((band * edge + z - chunk.z * edge) * edge + y - chunk.y * edge) * edge + part.lo.x -
            chunk.x * edge;
        const int64_t to =
            ((band * size.z + z - window.box.lo.z) * size.y + y - window.box.lo.y) * size.x +
            part.lo.x - window.box.lo.x;
        std::copy_n(values.data() + from, part.hi.x - part.lo.x, window.out.data() + to);
      }
    }
  }
}

Status StoredStep::PlanRuns(const Window& window,
                            const std::function<Status(const std::vector<Run>&)>& take) {
  WantedOfShards wanted;
  FOVEA_RETURN_IF_ERROR(FindWanted(window, &wanted));
  for (auto next = wanted.begin(); next != wanted.end();) {
    std::vector<Shard> shards;
    for (; next != wanted.end() && shards.size() < kMaxOpenShards; ++next) {
      shards.push_back(Open(window, std::move(next->second)));
    }
    std::vector<Run> runs;
    for (Shard& shard : shards) {
      FOVEA_RETURN_IF_ERROR(PlanShard(window, std::move(shard), &runs));
    }
    FOVEA_RETURN_IF_ERROR(take(runs));
  }
  return absl::OkStatus();
}

/// The bytes that a run reads at once: its chunks and what lies between them.
uint64_t RunBytes(const Run& run) {
  const ShardEntry& last = run.chunks.back().entry;
  return last.offset + last.bytes - run.chunks.front().entry.offset;
}

Status StoredStep::ReadRun(const Window& window, const Run& run) {
  const uint64_t start = run.chunks.front().entry.offset;
  std::vector<std::byte> bytes(RunBytes(run));
  const Status read = run.file->ReadAt(static_cast<int64_t>(start), bytes);
  bytes_read_ += bytes.size();
  Decoder decoder;
  std::vector<float> values(static_cast<size_t>(window.layout.ChunkValues()));
  for (const Wanted& one : run.chunks) {
    Status status = read;
    const Stopwatch watch;
    if (status.ok()) {
      status =
          decoder.DecodeValues(std::span(bytes).subspan(one.entry.offset - start, one.entry.bytes),
                               window.layout.coding, values);
    }
    decode_ns_ += static_cast<int64_t>(1e6 * watch.ElapsedMs());
    if (!status.ok()) {
      FOVEA_RETURN_IF_ERROR(Damaged(window.layout, one.chunk, Annotate(status, run.file->path())));
      continue;
    }
    CopyIntoWindow(window, one.chunk, values);
    ++chunks_read_;
  }
  return absl::OkStatus();
}

Status StoredStep::ReadRuns(const Window& window, const std::vector<Run>& runs) {
  for (const Run& run : runs) {  // all are asked of the disk before the first is waited for
    run.file->StartRead(static_cast<int64_t>(run.chunks.front().entry.offset),
                        static_cast<int64_t>(RunBytes(run)));
  }
  std::vector<Status> results(runs.size());
  ParallelFor(0, static_cast<int64_t>(runs.size()), 1, 0, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const auto at = static_cast<size_t>(i);
      results[at] = ReadRun(window, runs[at]);
    }
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return absl::OkStatus();
}

Status StoredStep::ReadDetail(int level, const Box3& box, std::span<float> out) {
  if (level < 0 || level >= info_.hierarchy.finest()) {
    return Internal("ReadDetail of level {}: there are {}", level, info_.hierarchy.finest());
  }
  const auto at = static_cast<size_t>(level);
  const auto values = static_cast<size_t>(kSubBands * box.Volume());
  if (!Box3::OfSize(layouts_[at].dims).Contains(box) || out.size() != values) {
    return Internal("ReadDetail of a window outside level {}, or into {} values instead of {}",
                    level, out.size(), values);
  }
  if (box.IsEmpty()) {
    return absl::OkStatus();
  }
  std::fill(out.begin(), out.end(), 0.0F);
  const Window window{layouts_[at], *tables_[at], box, out};
  return PlanRuns(window, [&](const std::vector<Run>& runs) { return ReadRuns(window, runs); });
}

Status StoredStep::CountReads(const RetainedSet& retained) {
  if (info_.IsLost(field_, step_)) {
    return LostStep();
  }
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile coarse, ReadableFile::Open(files_, CoarseFile()));
  bytes_read_ += static_cast<uint64_t>(coarse.size());
  ++chunks_read_;
  for (size_t level = 0; level < layouts_.size(); ++level) {
    const Box3& box = retained.window(static_cast<int>(level));
    if (box.IsEmpty()) {
      continue;
    }
    const auto count = [&](const std::vector<Run>& runs) {
      for (const Run& run : runs) {
        bytes_read_ += RunBytes(run);
        chunks_read_ += run.chunks.size();
      }
      return absl::OkStatus();
    };
    FOVEA_RETURN_IF_ERROR(PlanRuns({layouts_[level], *tables_[level], box, {}}, count));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<ReadStats> QuoteRead(Dataset& dataset, int64_t step, const std::string& field,
                              OnDamage on_damage, const RetainedSet& retained, FileSystem& files) {
  FOVEA_RETURN_IF_ERROR(dataset.OpenStep(step, field, on_damage).status());  // that they are there
  StoredStep source(files, dataset.path(), dataset.info(), step, field, on_damage);
  FOVEA_RETURN_IF_ERROR(source.CountReads(retained));
  return source.read_stats();
}

std::unique_ptr<StepSource> MakeStepSource(FileSystem& files, const std::string& store_path,
                                           const DatasetInfo& info, int64_t step,
                                           const std::string& field, OnDamage on_damage) {
  return std::make_unique<StoredStep>(files, store_path, info, step, field, on_damage);
}

}  // namespace fovea::store
