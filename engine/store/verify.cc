#include "engine/store/verify.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>

#include "engine/store/chunk_file.h"
#include "engine/store/dataset.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"
#include "engine/store/metadata.h"
#include "engine/store/retention.h"
#include "engine/store/survey.h"

namespace fovea::store {
namespace {

constexpr size_t kMaxProblems = 1000;

class Verifier final : public SurveyVisitor {
 public:
  Verifier(FileSystem& files, std::string path, DatasetInfo info, int threads)
      : files_(files),
        path_(std::move(path)),
        info_(std::move(info)),
        survey_(files, path_, info_, threads),
        retention_(files, path_, info_) {}

  /// The steps there is anything to check of: what metadata claims, but no more than files are
  /// there for.
  [[nodiscard]] int64_t Steps() const {
    return std::min(info_.committed_steps, survey_.steps_with_files());
  }
  void CheckMetadata();
  /// Some steps from `first` on; the one after them.
  [[nodiscard]] int64_t CheckSteps(int64_t first);
  [[nodiscard]] VerifyReport Finish();

  void OnStep(FoundStep& found) override;
  void OnShard(FoundStep& found, FoundLevel& level, FoundShard& shard) override;
  void OnLevelEnd(FoundStep& found, FoundLevel& level) override;

 private:
  void Problem(std::string text);
  void Note(const Status& status, const std::string& where);
  /// Reads one chunk file; false and a problem if it is missing or damaged.
  bool CheckFile(const std::string& path, std::span<std::byte> raw);
  void CheckSeries(int64_t step);
  void CheckTimes(int64_t step, SeriesChunk<int64_t>* times);

  FileSystem& files_;
  const std::string path_;
  const DatasetInfo info_;
  Survey survey_;
  NewestRetention retention_;  // a retain may have been stopped between a shard and its table
  int64_t last_series_ = -1;   // the last step whose rows were looked at
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
  for (const FieldInfo& field : info_.fields) {
    if (!field.lost_steps.empty()) {
      report_.lost_steps[field.name] = field.lost_steps;
    }
  }
  return std::move(report_);
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
    std::vector<std::string> stray;
    Note(survey_.List(array, &stray), "");
    for (const std::string& path : stray) {
      Problem(fmt::format("{} lies outside its array", path));
    }
  }
  const Status copy = ReadGroup(files_, path_, kGroupCopyName).status();
  if (absl::IsDataLoss(copy)) {  // older stores have none
    Note(copy, "");
  }
  // A writer may be at work: it may have committed since, and be some steps ahead of its commit.
  const StatusOr<DatasetInfo> now = ReadGroup(files_, path_);
  Note(now.status(), "");
  const int64_t most = now.ok() ? now->committed_steps + kMostStepsAtOnce : kMaxSteps;
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
  const StatusOr<int64_t> read = ReadChunkFile(files_, path, raw);
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

void Verifier::OnStep(FoundStep& found) {
  if (found.step != last_series_) {
    CheckSeries(found.step);
    last_series_ = found.step;
  }
  if (absl::IsNotFound(found.coarse)) {
    if (!found.lost) {
      Problem(fmt::format("{} is missing", found.coarse_path));
    }
  } else if (found.lost) {
    Problem(fmt::format("{} is there, and the step was marked as lost", found.coarse_path));
  } else {
    Note(found.coarse, "");
  }
  report_.chunks += found.chunks;
  report_.bytes += found.bytes;
  for (const FoundLevel& level : found.levels) {
    for (const auto& [block, status] : level.damaged_blocks) {
      if (!absl::IsNotFound(status)) {  // listed, and gone since: a retain is at work
        Note(status, "");
      }
    }
  }
}

void Verifier::OnShard(FoundStep& /*found*/, FoundLevel& level, FoundShard& shard) {
  const LevelLayout& layout = level.layout;
  const auto places = static_cast<size_t>(layout.shard_chunks.Product());
  if (absl::IsNotFound(shard.status)) {
    return;  // gone since it was listed: what is missing of it shows at the end of the level
  }
  Note(shard.status, "");
  if (!shard.status.ok()) {
    for (size_t place = 0; place < places; ++place) {
      level.Forget(layout.ChunkInShard(shard.shard, place));  // one line for all is enough
    }
    return;
  }
  auto bytes = static_cast<uint64_t>(ShardIndexBytes(places));
  for (const FoundChunk& chunk : shard.chunks) {
    bytes += chunk.entry.bytes;
    const float expected = level.Largest(chunk.at);
    const std::string where =
        fmt::format("{}: chunk {},{},{} (x, y, z)", shard.path, chunk.at.x, chunk.at.y, chunk.at.z);
    if (!chunk.status.ok()) {
      Note(chunk.status, where);
    } else if (chunk.largest != expected &&
               !level.damaged_blocks.contains(level.BlockOf(chunk.at)) &&
               !(expected == 0 && retention_.WasDropped(layout.level, chunk.at))) {
      Problem(fmt::format("{}: its largest coefficient is {}, chunk_max_{} says {}", where,
                          chunk.largest, layout.width, expected));
    }
    level.Forget(chunk.at);
  }
  report_.chunks += shard.chunks.size();
  report_.bytes += bytes;
  if (bytes != static_cast<uint64_t>(shard.file_bytes)) {
    Problem(fmt::format("{} has {} bytes, its chunks and index {}", shard.path, shard.file_bytes,
                        bytes));
  }
}

void Verifier::OnLevelEnd(FoundStep& found, FoundLevel& level) {
  const std::string folder = DetailPath(found.field, level.layout.width);
  for (const Int3& at : level.Chunks()) {
    if (retention_.WasDropped(level.layout.level, at)) {
      continue;
    }
    Problem(fmt::format("{}/{}: chunk {},{},{} (x, y, z) of step {} is missing", path_, folder,
                        at.x, at.y, at.z, found.step));
  }
}

int64_t Verifier::CheckSteps(int64_t first) {
  const int64_t end = std::min(Steps(), first + survey_.StepsAtOnce(first));
  survey_.Read(first, end, this);
  return end;
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
  for (int64_t step = 0; step < total;) {
    for (const int64_t end = verifier.CheckSteps(step); step < end; ++step) {
      if (progress && !progress(step + 1, total)) {
        return Cancelled("stopped after {} of {} steps of {}", step + 1, total, store);
      }
    }
  }
  return verifier.Finish();
}

}  // namespace fovea::store
