#ifndef SERVICE_JOBS_JOB_H_
#define SERVICE_JOBS_JOB_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

/// Long work that a server does by itself, in processes of their own, and that survives a restart:
/// a table on the disk, and what runs the jobs in it. Knows no gRPC.
namespace fovea::jobs {

/// The numbers are stored: they do not change.
enum class Kind { kIngestFiles = 1, kExport = 2 };
enum class State { kQueued = 1, kRunning = 2, kDone = 3, kFailed = 4, kCancelled = 5 };

[[nodiscard]] inline bool IsEnd(State state) {
  return state == State::kDone || state == State::kFailed || state == State::kCancelled;
}

/// One thing that could not be made.
struct Failure {
  std::string file;  // below its root
  std::string reason;
  friend bool operator==(const Failure&, const Failure&) = default;
};

/// How many records of failures are kept of a job; further ones are counted.
inline constexpr size_t kMaxFailures = 1000;

/// How many different warnings are kept of a job, the last of which says that there were more.
inline constexpr size_t kMaxWarnings = 100;

struct Progress {
  int64_t done = 0, total = 0;  // steps or frames, of earlier runs too; total 0: not known yet
  int64_t failed = 0;
  friend bool operator==(const Progress&, const Progress&) = default;
};

struct Job {
  int64_t number = 0;  // in the order of their making; the table gives it
  std::string id;
  Kind kind = Kind::kIngestFiles;
  State state = State::kQueued;
  std::string owner;    // the name of a token; empty: everyone
  std::string dataset;  // that is written or shown
  std::string target;   // of an export: its output, below the export root
  std::string request;  // v1::IngestFilesRequest or v1::CreateExportRequest, serialized
  Progress progress;
  std::string message;  // why it failed
  std::vector<Failure> failures;
  std::vector<std::string> warnings;  // each once, one line; of earlier runs, too
  int64_t created_ms = 0;             // since 1970 (UTC)
  std::optional<int64_t> started_ms, ended_ms;

  // Only while it runs, and not in the table:
  std::string now;  // the file in hand
  std::optional<double> seconds_left;
};

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_H_
