#ifndef INGEST_STEP_READER_H_
#define INGEST_STEP_READER_H_

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "engine/base/status.h"
#include "ingest/ingest.h"
#include "ingest/sequence.h"
#include "ingest/series_plan.h"
#include "ingest/step_assembler.h"
#include "ingest/worker_client.h"

namespace fovea::ingest {

/// Pass 1: asks a worker what is in each file (a file that is held is asked about once).
/// `from_voxels`: find the boxes from the voxels. `on_file` returns false to stop (CANCELLED).
[[nodiscard]] StatusOr<std::vector<ScannedFile>> ScanFiles(
    const IngestOptions& options, const std::vector<SequenceFile>& files, bool from_voxels,
    const std::function<bool(const std::string& path)>& on_file);

struct StepVoxels {
  std::vector<FieldVoxels> fields;
  /// Not empty: active voxels outside the extent, which the metadata did not announce.
  std::string outside;
  double read_ms = 0;
};

/// Pass 2: reads the steps of a plan in order, one ahead of whoever takes them, in a thread and a
/// worker of its own.
class StepReader {
 public:
  /// `options` and `plan` must outlive the reader.
  StepReader(const IngestOptions& options, const SeriesPlan& plan);
  /// Stops reading, wherever it is.
  ~StepReader();
  StepReader(const StepReader&) = delete;
  StepReader& operator=(const StepReader&) = delete;

  /// The next step; waits for it. To be called once for each step of the plan; not after an error.
  [[nodiscard]] StatusOr<StepVoxels> Next();

 private:
  void ReadAll();
  [[nodiscard]] StatusOr<StepVoxels> Read(const PlannedStep& step);

  const IngestOptions& options_;
  const SeriesPlan& plan_;
  WorkerClient client_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<StatusOr<StepVoxels>> ready_;  // guarded by mutex_
  bool stopped_ = false;                       // guarded by mutex_
  std::thread thread_;                         // last: uses all of the above
};

}  // namespace fovea::ingest

#endif  // INGEST_STEP_READER_H_
