#include "ingest/step_reader.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <set>
#include <system_error>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "ingest/detached_files.h"
#include "ingest/file_format.h"

namespace fovea::ingest {
namespace {

/// What the bricks of one step may take: two steps and the coefficients of one are in memory at a
/// time.
int64_t MaxStepBytes() {
  return int64_t{::sysconf(_SC_PHYS_PAGES)} * ::sysconf(_SC_PAGE_SIZE) / 4;
}

constexpr size_t kMostLanes = 2;
/// What may wait in a lane: so many parts, and so many bytes if there is more than one. Of sparse
/// fields, which come file by file, less: memory that is in the caches is used again.
constexpr size_t kMostParts = 64;
constexpr int64_t kMostPartBytes = 16 << 20;
constexpr int64_t kMostSparseBytes = 4 << 20;

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
      const std::vector<std::string> set = file.Paths();
      paths.insert(paths.end(), set.begin(), set.end());
    }
  }
  return paths;
}

std::vector<std::string> PathsOf(const SeriesPlan& plan) {
  std::set<std::string> paths;
  for (const std::vector<std::string>& set : plan.file_sets) {
    paths.insert(set.begin(), set.end());
  }
  return {paths.begin(), paths.end()};
}

WorkerOptions WorkerFor(const IngestOptions& options, int64_t declared_bytes,
                        std::vector<std::string> files) {
  WorkerOptions worker;
  worker.limits = options.worker;
  worker.declared_bytes = declared_bytes;
  for (const std::string& path : files) {
    const FileFormat format = FormatByName(path);
    worker.pictures |= format == FileFormat::kPicture;
    const bool is_sidecar = path.ends_with(".json");
    worker.openvdb |= format == FileFormat::kVdb || (format == FileFormat::kUnknown && !is_sidecar);
  }
  worker.openvdb &= !options.raw;
  worker.files = std::move(files);
  return worker;
}

size_t LanesOf(const IngestOptions& options, size_t steps) {
  const int threads = options.threads > 0 ? options.threads : HardwareThreads();
  return std::clamp<size_t>(steps, 1, threads > 1 ? kMostLanes : 1);
}

/// As many as will read, though one scans: a worker takes its time to start. Files are compressed
/// more often than not, so that what they declare will be more than their size.
void StartWorkers(const IngestOptions& options, const std::vector<SequenceFile>& files,
                  Workers* workers) {
  constexpr int64_t kMostExpansion = 4;
  const int64_t largest = std::min(LargestFile(files), INT64_MAX / kMostExpansion);
  const WorkerOptions needed = WorkerFor(options, kMostExpansion * largest, PathsOf(files));
  workers->clear();
  for (size_t lane = 0; lane < LanesOf(options, files.size()); ++lane) {
    workers->push_back(std::make_unique<WorkerClient>(needed));
    workers->back()->Prepare();
  }
}

ReaderHints HintsOf(const IngestOptions& options) {
  return {options.raw, options.channel, options.axes, options.slices_per_step};
}

StatusOr<ScannedFile> ScanSet(const IngestOptions& options, const SequenceFile& file,
                              bool from_voxels, WorkerClient* client) {
  constexpr size_t kMaxGrids = 100'000;
  ScannedFile scanned{file, {}, {}};
  if (options.raw && FormatByName(file.path) == FileFormat::kPicture) {
    return InvalidArgument("'{}' is a picture by its name: --raw is for headerless voxels",
                           file.path);
  }
  client->Allow(file.Paths());
  FOVEA_RETURN_IF_ERROR(
      client->Call(file.path, Encode(ScanRequest{file.Paths(), HintsOf(options), from_voxels}), {},
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

/// Scans a file, and once more with the files that its header names.
StatusOr<ScannedFile> ScanFile(const IngestOptions& options, const SequenceFile& file,
                               bool from_voxels, WorkerClient* client) {
  FOVEA_ASSIGN_OR_RETURN(ScannedFile scanned, ScanSet(options, file, from_voxels, client));
  if (scanned.info.needs.empty()) {
    return scanned;
  }
  SequenceFile whole = file;
  auto detached = FindDetached(file.path, scanned.info.needs);
  FOVEA_RETURN_IF_ERROR(detached.status());
  whole.further.insert(whole.further.end(), detached->begin(), detached->end());
  FOVEA_ASSIGN_OR_RETURN(scanned, ScanSet(options, whole, from_voxels, client));
  if (!scanned.info.needs.empty()) {
    return Internal("{}: malformed message: it needs files that it has", file.path);
  }
  return scanned;
}

/// Looks through files with several workers, each of them taking the next one.
class Scan {
 public:
  Scan(const IngestOptions& options, const std::vector<SequenceFile>& files, bool from_voxels,
       const std::function<bool(const std::string& path)>& on_file)
      : options_(options),
        files_(files),
        from_voxels_(from_voxels),
        on_file_(on_file),
        scanned_(files.size(), Cancelled("not looked at")),
        failed_at_(files.size()) {}

  /// Until there are no more files, or none before one that failed.
  void Work(WorkerClient* client, bool tells) {
    for (size_t i = next_++; i < failed_at_; i = next_++) {
      if (files_[i].held) {
        continue;
      }
      if (tells && !on_file_(files_[i].path)) {
        stopped_ = true;
        failed_at_ = 0;
        return;
      }
      scanned_[i] = ScanFile(options_, files_[i], from_voxels_, client);
      for (size_t at = failed_at_; !scanned_[i].ok() && i < at;) {
        failed_at_.compare_exchange_weak(at, i);
      }
    }
  }

  [[nodiscard]] StatusOr<std::vector<ScannedFile>> Take() {
    if (stopped_) {
      return Cancelled("stopped while looking through the files; nothing was written");
    }
    std::vector<ScannedFile> all;
    for (size_t i = 0; i < files_.size(); ++i) {
      if (files_[i].held) {
        ScannedFile held{files_[i], all.back().info, all.back().grids};
        held.file.further = all.back().file.further;
        all.push_back(std::move(held));
        continue;
      }
      FOVEA_RETURN_IF_ERROR(scanned_[i].status());
      all.push_back(*std::move(scanned_[i]));
    }
    return all;
  }

 private:
  const IngestOptions& options_;
  const std::vector<SequenceFile>& files_;
  const bool from_voxels_;
  const std::function<bool(const std::string& path)>& on_file_;
  std::vector<StatusOr<ScannedFile>> scanned_;  // each by who took it
  std::atomic<size_t> next_ = 0;
  std::atomic<size_t> failed_at_;  // the first that did
  std::atomic<bool> stopped_ = false;
};

}  // namespace

StatusOr<std::vector<ScannedFile>> ScanFiles(
    const IngestOptions& options, const std::vector<SequenceFile>& files, bool from_voxels,
    const std::function<bool(const std::string& path)>& on_file, Workers* workers) {
  StartWorkers(options, files, workers);
  Scan scan(options, files, from_voxels, on_file);
  std::vector<std::thread> threads;
  for (size_t i = 1; i < workers->size(); ++i) {
    threads.emplace_back([&scan, &worker = (*workers)[i]] {
      const pid_t before = worker->pid();
      scan.Work(worker.get(), /*tells=*/false);
      if (worker->pid() != before) {
        worker.reset();  // one that was started here goes with this thread
      }
    });
  }
  scan.Work(workers->front().get(), /*tells=*/true);
  for (std::thread& thread : threads) {
    thread.join();
  }
  return scan.Take();
}

StepReader::StepReader(const IngestOptions& options, const SeriesPlan& plan, Workers workers)
    : options_(options), plan_(plan) {
  const WorkerOptions needed = WorkerFor(options, plan.declared_bytes, PathsOf(plan));
  workers.resize(LanesOf(options, plan.steps.size()));
  for (std::unique_ptr<WorkerClient>& worker : workers) {
    if (worker == nullptr || !worker->Suits(needed)) {
      worker = std::make_unique<WorkerClient>(needed);
    }
    lanes_.push_back(std::make_unique<Lane>(std::move(worker)));
  }
  const size_t lanes = lanes_.size();
  for (size_t lane = 0; lane < lanes; ++lane) {
    lanes_[lane]->thread = std::thread([this, lane] { ReadAll(lane); });
  }
}

StepReader::~StepReader() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
  for (const auto& lane : lanes_) {
    lane->client->Interrupt();
  }
  for (const auto& lane : lanes_) {
    lane->thread.join();
  }
}

StatusOr<StepPart> StepReader::Next() {
  std::unique_lock lock(mutex_);
  Lane& lane = *lanes_[next_step_ % lanes_.size()];
  changed_.wait(lock, [&] { return !lane.parts.empty(); });
  StatusOr<StepPart> part = std::move(lane.parts.front().part);
  lane.bytes -= lane.parts.front().bytes;
  lane.parts.pop_front();
  if (part.ok() && std::holds_alternative<StepEnd>(*part)) {
    ++next_step_;
  }
  changed_.notify_all();
  return part;
}

Status StepReader::Push(Lane* lane, StatusOr<StepPart> part, int64_t bytes) {
  const Stopwatch watch;
  const bool is_sparse = part.ok() && std::holds_alternative<SparseField>(*part);
  const int64_t most = is_sparse ? kMostSparseBytes : kMostPartBytes;
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] {
    return stopped_ || lane->parts.empty() ||
           (lane->parts.size() < kMostParts && lane->bytes + bytes <= most);
  });
  if (stopped_) {
    return Cancelled("stopped");
  }
  lane->parts.push_back({std::move(part), bytes});
  lane->bytes += bytes;
  lane->waited_ms += watch.ElapsedMs();
  changed_.notify_all();
  return absl::OkStatus();
}

void StepReader::ReadAll(size_t lane) {
  for (size_t step = lane; step < plan_.steps.size(); step += lanes_.size()) {
    const Status status = Read(plan_.steps[step], lanes_[lane].get());
    if (!status.ok()) {
      [[maybe_unused]] const Status stopped = Push(lanes_[lane].get(), status, 0);
      return;
    }
  }
  lanes_[lane]->client->Dismiss();  // while the last steps are written
}

Status StepReader::Read(const PlannedStep& step, Lane* lane) {
  const Stopwatch watch;
  lane->waited_ms = 0;
  int64_t bytes_left = MaxStepBytes();
  std::vector<bool> is_read(step.sources.size(), false);
  for (size_t first = 0; first < step.sources.size(); ++first) {
    if (is_read[first]) {
      continue;
    }
    // All fields that come from the same place, in one request.
    const FieldSource& source = step.sources[first];
    ReadRequest request{plan_.file_sets[source.file_set],
                        HintsOf(options_),
                        source.step_in_file,
                        plan_.extent,
                        {},
                        plan_.lattice};
    std::vector<size_t> members;
    for (size_t i = first; i < step.sources.size(); ++i) {
      const FieldSource& other = step.sources[i];
      if (other.file_set == source.file_set && other.step_in_file == source.step_in_file) {
        members.push_back(i);
        is_read[i] = true;
        request.grids.push_back(other.grid);
      }
    }
    lane->client->Allow(plan_.file_sets[source.file_set]);
    FOVEA_RETURN_IF_ERROR(ReadFields(source.path, request, members, &bytes_left, lane));
  }
  return Push(lane, StepPart(StepEnd{watch.ElapsedMs() - lane->waited_ms}), 0);
}

Status StepReader::ReadFields(const std::string& path, const ReadRequest& request,
                              const std::vector<size_t>& members, int64_t* bytes_left, Lane* lane) {
  StepAssembler assembler(plan_.extent, options_.chunk_edge, members.size(), *bytes_left);
  DenseField dense(plan_.extent, 2 * options_.chunk_edge, *bytes_left / 8);
  const auto push = [&](DenseSlices slices) -> Status {
    const double before = lane->waited_ms;
    const int64_t bytes = slices.bytes;
    const Status pushed =
        Push(lane, StepPart(DensePiece{members.front(), std::move(slices)}), bytes);
    lane->client->Excuse(
        std::chrono::microseconds(static_cast<int64_t>(1000 * (lane->waited_ms - before))));
    return pushed;
  };
  FOVEA_RETURN_IF_ERROR(
      lane->client->Call(path, Encode(request), {}, [&](const FrameView& reply) -> Status {
        const bool is_dense = reply.kind == FrameKind::kDense && members.size() == 1;
        return is_dense || dense.has_begun() ? dense.Consume(reply, lane->client->slabs(), push)
                                             : assembler.Consume(reply);
      }));
  if (dense.has_begun()) {
    auto end = dense.Finish();
    FOVEA_RETURN_IF_ERROR(Annotate(end.status(), path));
    end->field = members.front();
    return Push(lane, StepPart(*std::move(end)), 0);
  }
  auto fields = assembler.Finish();
  FOVEA_RETURN_IF_ERROR(Annotate(fields.status(), path));
  *bytes_left = assembler.bytes_left();
  for (size_t i = 0; i < members.size(); ++i) {
    SparseField field{members[i], std::move((*fields)[i]), ""};
    if (!plan_.extent.Contains(field.voxels.active)) {
      field.outside = fmt::format("{}: grid '{}'", path, Printable(request.grids[i]));
    }
    const BrickGrid& voxels = field.voxels.voxels;
    const int64_t bytes = std::ssize(voxels.bricks()) * voxels.brick_values() * 4;
    FOVEA_RETURN_IF_ERROR(Push(lane, StepPart(std::move(field)), bytes));
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
