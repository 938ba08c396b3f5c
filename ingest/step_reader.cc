#include "ingest/step_reader.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <system_error>
#include <utility>

#include "engine/base/stopwatch.h"

namespace fovea::ingest {
namespace {

/// What the bricks of one step may take: two steps and the coefficients of one are in memory at a
/// time.
int64_t MaxStepBytes() {
  return int64_t{::sysconf(_SC_PHYS_PAGES)} * ::sysconf(_SC_PAGE_SIZE) / 4;
}

int64_t LargestFile(const std::vector<SequenceFile>& files) {
  int64_t largest = 0;
  for (const SequenceFile& file : files) {
    std::error_code error;
    const auto bytes = std::filesystem::file_size(file.path, error);
    largest = error ? largest : std::max(largest, static_cast<int64_t>(bytes));
  }
  return largest;
}

std::vector<std::string> PathsOf(const std::vector<SequenceFile>& files) {
  std::vector<std::string> paths;
  for (const SequenceFile& file : files) {
    if (!file.held) {
      paths.push_back(file.path);
    }
  }
  return paths;
}

std::vector<std::string> PathsOf(const SeriesPlan& plan) {
  std::set<std::string> paths;
  for (const PlannedStep& step : plan.steps) {
    for (const FieldSource& source : step.sources) {
      paths.insert(source.path);
    }
  }
  return {paths.begin(), paths.end()};
}

WorkerOptions WorkerFor(const IngestOptions& options, int64_t declared_bytes,
                        std::vector<std::string> files) {
  WorkerOptions worker;
  worker.limits = options.worker;
  worker.declared_bytes = declared_bytes;
  worker.files = std::move(files);
  return worker;
}

StatusOr<ScannedFile> ScanFile(const IngestOptions& options, const SequenceFile& file,
                               bool from_voxels, WorkerClient* client) {
  constexpr size_t kMaxGrids = 100'000;
  ScannedFile scanned{file, {}, {}};
  client->Allow({file.path});
  FOVEA_RETURN_IF_ERROR(
      client->Call(file.path, Encode(ScanRequest{file.path, options.raw, from_voxels}), {},
                   [&](const FrameView& reply) -> Status {
                     if (reply.kind == FrameKind::kFile) {
                       FOVEA_ASSIGN_OR_RETURN(scanned.info, DecodeFileInfo(reply));
                       return absl::OkStatus();
                     }
                     FOVEA_ASSIGN_OR_RETURN(GridInfo grid, DecodeGridInfo(reply));
                     if (scanned.grids.size() >= kMaxGrids) {
                       return Internal("malformed message: too many grids");
                     }
                     scanned.grids.push_back(std::move(grid));
                     return absl::OkStatus();
                   }));
  return scanned;
}

}  // namespace

StatusOr<std::vector<ScannedFile>> ScanFiles(
    const IngestOptions& options, const std::vector<SequenceFile>& files, bool from_voxels,
    const std::function<bool(const std::string& path)>& on_file) {
  WorkerClient client(WorkerFor(options, LargestFile(files), PathsOf(files)));
  std::vector<ScannedFile> scanned;
  for (const SequenceFile& file : files) {
    if (!on_file(file.path)) {
      return Cancelled("stopped while looking through the files; nothing was written");
    }
    if (file.held) {
      scanned.push_back({file, scanned.back().info, scanned.back().grids});
      continue;
    }
    FOVEA_ASSIGN_OR_RETURN(ScannedFile one, ScanFile(options, file, from_voxels, &client));
    scanned.push_back(std::move(one));
  }
  return scanned;
}

StepReader::StepReader(const IngestOptions& options, const SeriesPlan& plan)
    : options_(options),
      plan_(plan),
      client_(WorkerFor(options, options.raw ? 0 : plan.declared_bytes, PathsOf(plan))),
      thread_([this] { ReadAll(); }) {}

StepReader::~StepReader() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
  client_.Interrupt();
  thread_.join();
}

StatusOr<StepVoxels> StepReader::Next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return ready_.has_value(); });
  StatusOr<StepVoxels> step = std::move(*ready_);
  ready_.reset();
  changed_.notify_all();
  return step;
}

void StepReader::ReadAll() {
  for (const PlannedStep& step : plan_.steps) {
    StatusOr<StepVoxels> voxels = Read(step);
    const bool is_last = !voxels.ok();
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return stopped_ || !ready_.has_value(); });
    if (stopped_) {
      return;
    }
    ready_ = std::move(voxels);
    changed_.notify_all();
    if (is_last) {
      return;
    }
  }
}

StatusOr<StepVoxels> StepReader::Read(const PlannedStep& step) {
  const Stopwatch watch;
  StepVoxels result;
  result.fields.resize(step.sources.size());
  int64_t bytes_left = MaxStepBytes();
  std::vector<bool> is_read(step.sources.size(), false);
  for (size_t first = 0; first < step.sources.size(); ++first) {
    if (is_read[first]) {
      continue;
    }
    // All fields that come from the same place, in one request.
    const FieldSource& source = step.sources[first];
    ReadRequest request{source.path, options_.raw, source.step_in_file, plan_.extent, {}};
    std::vector<size_t> members;
    for (size_t i = first; i < step.sources.size(); ++i) {
      const FieldSource& other = step.sources[i];
      if (other.path == source.path && other.step_in_file == source.step_in_file) {
        members.push_back(i);
        is_read[i] = true;
        request.grids.push_back(other.grid);
      }
    }
    StepAssembler assembler(plan_.extent, options_.chunk_edge, members.size(), bytes_left);
    client_.Allow({source.path});
    FOVEA_RETURN_IF_ERROR(
        client_.Call(source.path, Encode(request), {},
                     [&](const FrameView& reply) { return assembler.Consume(reply); }));
    auto fields = assembler.Finish();
    FOVEA_RETURN_IF_ERROR(Annotate(fields.status(), source.path));
    bytes_left = assembler.bytes_left();
    for (size_t i = 0; i < members.size(); ++i) {
      if (!plan_.extent.Contains((*fields)[i].active)) {
        result.outside = fmt::format("{}: grid '{}'", source.path, Printable(request.grids[i]));
      }
      result.fields[members[i]] = std::move((*fields)[i]);
    }
  }
  result.read_ms = watch.ElapsedMs();
  return result;
}

}  // namespace fovea::ingest
