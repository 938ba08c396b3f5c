#include "engine/store/verify.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/metadata.h"

namespace fovea::store {
namespace {

constexpr size_t kMaxProblems = 1000;

using Indices = std::vector<int64_t>;

/// The chunk files of one array: by their index along t, the indices of the others.
using FilesByTime = std::map<int64_t, std::vector<Indices>>;

/// The table of one level of one step: largest |coefficient| by chunk {z, y, x}. What is found in
/// shards is taken out; what is left is missing.
struct Table {
  std::map<std::array<int64_t, 3>, float> largest;
  bool damaged = false;  // then nothing is known of chunks that are not in it
};

class Verifier {
 public:
  Verifier(FileSystem& files, std::string path, DatasetInfo info, int threads)
      : files_(files), path_(std::move(path)), info_(std::move(info)), threads_(threads) {}

  /// The steps there is anything to check of: what metadata claims, but no more than files are
  /// there for.
  [[nodiscard]] int64_t Steps() const { return std::min(info_.committed_steps, steps_with_files_); }
  void CheckMetadata();
  void CheckStep(int64_t step);
  [[nodiscard]] VerifyReport Finish();

 private:
  void Problem(std::string text);
  void Note(const Status& status, const std::string& where);
  void ListFiles(const ArraySpec& array);
  /// Reads one chunk file; false and a problem if it is missing or damaged.
  bool CheckFile(const std::string& path, std::span<std::byte> raw);
  /// Counts a file that was read, or notes why it was not.
  bool CountFile(const std::string& path, const StatusOr<int64_t>& read);
  void CheckSeries(int64_t step);
  void CheckTimes(int64_t step, SeriesChunk<int64_t>* times);
  void CheckLevel(const std::string& field, const LevelLayout& layout, int64_t step);
  [[nodiscard]] Table ReadTable(const std::string& field, const LevelLayout& layout, int64_t step);
  void CheckShard(const LevelLayout& layout, const std::string& path, const Int3& shard,
                  Table* table);
  void CheckChunks(const LevelLayout& layout, const ReadableFile& file,
                   const std::vector<std::pair<Int3, ShardEntry>>& chunks, Table* table);

  FileSystem& files_;
  const std::string path_;
  const DatasetInfo info_;
  const int threads_;
  std::map<std::string, FilesByTime> chunk_files_;  // by array
  int64_t steps_with_files_ = 0;
  int64_t last_time_ns_ = std::numeric_limits<int64_t>::min();
  size_t more_problems_ = 0;
  VerifyReport report_;
};

void Verifier::Problem(std::string text) {
  if (report_.problems.size() < kMaxProblems) {
    report_.problems.push_back(std::move(text));
  } else {
    ++more_problems_;
  }
}

void Verifier::Note(const Status& status, const std::string& where) {
  if (!status.ok()) {
    Problem(where.empty() ? std::string(MessageOf(status))
                          : fmt::format("{}: {}", where, MessageOf(status)));
  }
}

VerifyReport Verifier::Finish() {
  if (more_problems_ > 0) {
    report_.problems.push_back(fmt::format("and {} more", more_problems_));
  }
  return std::move(report_);
}

void Verifier::ListFiles(const ArraySpec& array) {
  const StatusOr<std::vector<std::string>> names = ListDirectory(files_, path_ + "/" + array.path);
  Note(names.status(), "");
  if (!names.ok()) {
    return;
  }
  const std::vector<int64_t> grid = array.FileGrid();
  const int64_t files = (info_.committed_steps + array.FileSteps() - 1) / array.FileSteps();
  for (const std::string& name : *names) {
    const std::optional<Indices> indices = ParseChunkName(name, grid.size() + 1);
    if (!indices || indices->front() >= files) {
      continue;  // metadata, temporary files, a step that is not committed
    }
    steps_with_files_ = std::max(steps_with_files_, (indices->front() + 1) * array.FileSteps());
    Indices rest(indices->begin() + 1, indices->end());
    if (std::equal(rest.begin(), rest.end(), grid.begin(), std::less<>())) {
      chunk_files_[array.path][indices->front()].push_back(std::move(rest));
    } else {
      Problem(fmt::format("{}/{}/{} lies outside its array", path_, array.path, name));
    }
  }
}

void Verifier::CheckMetadata() {
  for (const FieldInfo& field : info_.fields) {
    Note(CheckFieldGroup(files_, path_, field.name), "");
  }
  std::vector<std::pair<std::string, int64_t>> lengths;
  for (const ArraySpec& array : AllArrays(info_)) {
    const StatusOr<int64_t> steps = ReadArraySteps(files_, path_, array);
    Note(steps.status(), "");
    if (steps.ok()) {
      lengths.emplace_back(array.path, *steps);
    }
    ListFiles(array);
  }
  // A writer may be at work: it may have committed since, and be one step ahead of its commit.
  const StatusOr<DatasetInfo> now = ReadGroup(files_, path_);
  Note(now.status(), "");
  const int64_t most = now.ok() ? now->committed_steps + 1 : kMaxSteps;
  for (const auto& [array, steps] : lengths) {
    if (steps < info_.committed_steps || steps > most) {
      Problem(fmt::format("{}/{} has {} steps, the store {}", path_, array, steps,
                          info_.committed_steps));
    }
  }
  report_.steps = info_.committed_steps;
  if (Steps() < info_.committed_steps) {
    Problem(fmt::format("{}: nothing is there of steps {} to {}", path_, Steps(),
                        info_.committed_steps - 1));
  }
}

bool Verifier::CheckFile(const std::string& path, std::span<std::byte> raw) {
  return CountFile(path, ReadChunkFile(files_, path, raw));
}

bool Verifier::CountFile(const std::string& path, const StatusOr<int64_t>& read) {
  if (!read.ok()) {
    Problem(absl::IsNotFound(read.status()) ? fmt::format("{} is missing", path)
                                            : std::string(MessageOf(read.status())));
    return false;
  }
  ++report_.chunks;
  report_.bytes += static_cast<uint64_t>(*read);
  return true;
}

void Verifier::CheckTimes(int64_t step, SeriesChunk<int64_t>* times) {
  const int64_t end = std::min(step + times->steps, info_.committed_steps);
  for (int64_t at = step; at < end; ++at) {
    const int64_t time_ns = times->Row(at)[0];
    if (time_ns < last_time_ns_) {
      Problem(fmt::format("step {} is at {} ns, before the step before it", at, time_ns));
    }
    last_time_ns_ = time_ns;
  }
}

/// Checks those chunks of time, stats ... whose first row is that of `step`.
void Verifier::CheckSeries(int64_t step) {
  if (step % kSeriesSteps == 0) {
    SeriesChunk<int64_t> chunk(kSeriesSteps, 1, 0);
    if (CheckFile(SeriesPath(path_, std::string(kTimePath), step, kSeriesSteps, false),
                  chunk.Bytes())) {
      CheckTimes(step, &chunk);
    }
    CheckFile(SeriesPath(path_, std::string(kFrameNumberPath), step, kSeriesSteps, false),
              chunk.Bytes());
  }
  for (const FieldInfo& field : info_.fields) {
    if (step % kSeriesSteps == 0) {
      SeriesChunk<double> chunk(kSeriesSteps, 2, 0);
      CheckFile(SeriesPath(path_, StatsPath(field.name), step, kSeriesSteps, true), chunk.Bytes());
    }
    if (step % kHistogramSteps == 0) {
      SeriesChunk<uint64_t> chunk(kHistogramSteps, 256, 0);
      CheckFile(SeriesPath(path_, HistogramPath(field.name), step, kHistogramSteps, true),
                chunk.Bytes());
    }
  }
}

void Verifier::CheckStep(int64_t step) {
  CheckSeries(step);
  for (const FieldInfo& field : info_.fields) {
    std::vector<float> coarse(static_cast<size_t>(info_.hierarchy.DimsAt(0).Product()));
    const std::string path = fmt::format("{}/{}/{}", path_, CoarsePath(field.name),
                                         SpaceChunkName(step, {0, 0, 0}, /*with_bands=*/false));
    CountFile(path, ReadValuesFile(files_, path, CoarseCoding(field), coarse));
    for (int level = 0; level < info_.hierarchy.finest(); ++level) {
      CheckLevel(field.name, LevelLayout::Make(info_, field, level), step);
    }
  }
}

Table Verifier::ReadTable(const std::string& field, const LevelLayout& layout, int64_t step) {
  Table table;
  const std::string folder = TablePath(field, layout.width);
  const Int3& edge = layout.table_edge;
  for (const Indices& block : chunk_files_[folder][step]) {
    std::vector<float> values(static_cast<size_t>(edge.Product()));
    const Int3 at{block[2], block[1], block[0]};
    const std::string name = SpaceChunkName(step, at, /*with_bands=*/false);
    if (!CheckFile(fmt::format("{}/{}/{}", path_, folder, name),
                   std::as_writable_bytes(std::span(values)))) {
      table.damaged = true;
      continue;
    }
    for (int64_t i = 0; i < edge.Product(); ++i) {
      if (const float largest = values[static_cast<size_t>(i)]; largest != 0) {
        table.largest[{at.z * edge.z + i / (edge.y * edge.x), at.y * edge.y + i / edge.x % edge.y,
                       at.x * edge.x + i % edge.x}] = largest;
      }
    }
  }
  return table;
}

void Verifier::CheckLevel(const std::string& field, const LevelLayout& layout, int64_t step) {
  Table table = ReadTable(field, layout, step);
  const std::string folder = DetailPath(field, layout.width);
  for (const Indices& file : chunk_files_[folder][step]) {
    const Int3 shard{file[3], file[2], file[1]};
    const std::string name = SpaceChunkName(step, shard, /*with_bands=*/true);
    CheckShard(layout, fmt::format("{}/{}/{}", path_, folder, name), shard, &table);
  }
  for (const auto& [at, largest] : table.largest) {
    Problem(fmt::format("{}/{}: chunk {},{},{} (x, y, z) of step {} is missing", path_, folder,
                        at[2], at[1], at[0], step));
  }
}

void Verifier::CheckShard(const LevelLayout& layout, const std::string& path, const Int3& shard,
                          Table* table) {
  const Int3& size = layout.shard_chunks;
  const auto places = static_cast<size_t>(size.Product());
  const StatusOr<ReadableFile> file = ReadableFile::Open(files_, path);
  StatusOr<ShardIndex> index =
      file.ok() ? ReadShardIndex(*file, places, MaxEncodedBytes(layout.ChunkBytes()))
                : StatusOr<ShardIndex>(file.status());
  Note(index.status(), "");
  std::vector<std::pair<Int3, ShardEntry>> chunks;
  uint64_t bytes = static_cast<uint64_t>(ShardIndexBytes(places));
  for (size_t place = 0; place < places; ++place) {
    const auto i = static_cast<int64_t>(place);
    const Int3 at{shard.x * size.x + i % size.x, shard.y * size.y + i / size.x % size.y,
                  shard.z * size.z + i / (size.x * size.y)};
    if (!index.ok()) {
      table->largest.erase({at.z, at.y, at.x});  // one line for all of them is enough
    } else if (const std::optional<ShardEntry>& entry = (*index)[place]; entry) {
      chunks.emplace_back(at, *entry);
      bytes += entry->bytes;
    }
  }
  if (index.ok()) {
    report_.bytes += bytes;
    if (bytes != static_cast<uint64_t>(file->size())) {
      Problem(fmt::format("{} has {} bytes, its chunks and index {}", path, file->size(), bytes));
    }
    CheckChunks(layout, *file, chunks, table);
  }
}

/// Reads and decodes one chunk; its largest |coefficient|.
StatusOr<float> LargestOf(const ReadableFile& file, const ShardEntry& entry, const Coding& coding,
                          Decoder* decoder, std::vector<float>* values) {
  std::vector<std::byte> bytes(entry.bytes);
  FOVEA_RETURN_IF_ERROR(file.ReadAt(static_cast<int64_t>(entry.offset), bytes));
  FOVEA_RETURN_IF_ERROR(decoder->DecodeValues(bytes, coding, *values));
  const float largest = LargestMagnitude(*values);
  if (!std::isfinite(largest)) {
    return DataLoss("a coefficient is not finite");
  }
  return largest;
}

void Verifier::CheckChunks(const LevelLayout& layout, const ReadableFile& file,
                           const std::vector<std::pair<Int3, ShardEntry>>& chunks, Table* table) {
  std::vector<StatusOr<float>> results(chunks.size(), 0.0F);
  ParallelFor(0, std::ssize(chunks), 8, threads_, [&](int64_t first, int64_t last) {
    Decoder decoder;
    std::vector<float> values(static_cast<size_t>(layout.ChunkValues()));
    for (int64_t i = first; i < last; ++i) {
      const auto at = static_cast<size_t>(i);
      results[at] = LargestOf(file, chunks[at].second, layout.coding, &decoder, &values);
    }
  });
  report_.chunks += chunks.size();
  for (size_t i = 0; i < chunks.size(); ++i) {
    const Int3& at = chunks[i].first;
    const auto entry = table->largest.find({at.z, at.y, at.x});
    const float expected = entry == table->largest.end() ? 0.0F : entry->second;
    const std::string where =
        fmt::format("{}: chunk {},{},{} (x, y, z)", file.path(), at.x, at.y, at.z);
    if (!results[i].ok()) {
      Note(results[i].status(), where);
    } else if (*results[i] != expected && !(expected == 0 && table->damaged)) {
      Problem(fmt::format("{}: its largest coefficient is {}, chunk_max_{} says {}", where,
                          *results[i], layout.width, expected));
    }
    if (entry != table->largest.end()) {
      table->largest.erase(entry);
    }
  }
}

}  // namespace

StatusOr<VerifyReport> Verify(const std::string& path, int threads,
                              const std::function<bool(int64_t, int64_t)>& progress,
                              FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const std::string store, StorePath(path));
  FOVEA_ASSIGN_OR_RETURN(DatasetInfo info, ReadGroup(files, store));
  Verifier verifier(files, store, std::move(info), threads);
  verifier.CheckMetadata();
  const int64_t total = verifier.Steps();
  for (int64_t step = 0; step < total; ++step) {
    verifier.CheckStep(step);
    if (progress && !progress(step + 1, total)) {
      return Cancelled("stopped after {} of {} steps of {}", step + 1, total, store);
    }
  }
  return verifier.Finish();
}

}  // namespace fovea::store
