#ifndef INGEST_STEP_READER_H_
#define INGEST_STEP_READER_H_

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "engine/base/status.h"
#include "ingest/dense_field.h"
#include "ingest/ingest.h"
#include "ingest/sequence.h"
#include "ingest/series_plan.h"
#include "ingest/step_assembler.h"
#include "ingest/worker_client.h"

namespace fovea::ingest {

/// Worker processes of one series, each confined to its files.
using Workers = std::vector<std::unique_ptr<WorkerClient>>;

/// Pass 1: asks a worker what is in each file (a file that is held is asked about once).
/// `from_voxels`: find the boxes from the voxels. `on_file` returns false to stop (CANCELLED).
/// Leaves in `workers` those that it started, for StepReader.
[[nodiscard]] StatusOr<std::vector<ScannedFile>> ScanFiles(
    const IngestOptions& options, const std::vector<SequenceFile>& files, bool from_voxels,
    const std::function<bool(const std::string& path)>& on_file, Workers* workers);

/// A whole field of a step, from a sparse file.
struct SparseField {
  size_t field = 0;  // in the plan
  FieldVoxels voxels;
  /// Not empty: active voxels outside the extent, which the metadata did not announce.
  std::string outside;
};
/// The next slices of a field of a dense file. Fields come one after another.
struct DensePiece {
  size_t field = 0;
  DenseSlices slices;
};
struct StepEnd {
  double read_ms = 0;  // what reading took, without waiting for whoever takes it
};
using StepPart = std::variant<SparseField, DensePiece, DenseEnd, StepEnd>;

/// Pass 2: reads the steps of a plan in order, ahead of whoever takes them, each in parts as they
/// come. Two steps are read at a time, each in a thread and a worker of its own, where there are
/// that many.
class StepReader {
 public:
  /// `options` and `plan` must outlive the reader. Of `workers`, those that may use the memory that
  /// the plan needs go on.
  StepReader(const IngestOptions& options, const SeriesPlan& plan, Workers workers);
  /// Stops reading, wherever it is.
  ~StepReader();
  StepReader(const StepReader&) = delete;
  StepReader& operator=(const StepReader&) = delete;

  /// The next part; waits for it. To be called up to the end of the last step; not after an error.
  [[nodiscard]] StatusOr<StepPart> Next();

 private:
  struct Waiting {
    StatusOr<StepPart> part;
    int64_t bytes = 0;
  };
  /// What reads every n-th step.
  struct Lane {
    explicit Lane(std::unique_ptr<WorkerClient> worker) : client(std::move(worker)) {}
    std::unique_ptr<WorkerClient> client;
    std::deque<Waiting> parts;  // guarded by mutex_
    int64_t bytes = 0;          // of them; guarded by mutex_
    double waited_ms = 0;       // for room for parts
    std::thread thread;
  };

  void ReadAll(size_t lane);
  /// Waits for room.
  [[nodiscard]] Status Push(Lane* lane, StatusOr<StepPart> part, int64_t bytes);
  [[nodiscard]] Status Read(const PlannedStep& step, Lane* lane);
  /// All fields of one request: `members` of the plan.
  [[nodiscard]] Status ReadFields(const std::string& path, const ReadRequest& request,
                                  const std::vector<size_t>& members, int64_t* bytes_left,
                                  Lane* lane);

  const IngestOptions& options_;
  const SeriesPlan& plan_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopped_ = false;  // guarded by mutex_
  size_t next_step_ = 0;  // whose parts are taken
  std::vector<std::unique_ptr<Lane>> lanes_;
};

}  // namespace fovea::ingest

#endif  // INGEST_STEP_READER_H_
