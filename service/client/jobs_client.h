#ifndef SERVICE_CLIENT_JOBS_CLIENT_H_
#define SERVICE_CLIENT_JOBS_CLIENT_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/client/client.h"
#include "service/frames/spec.h"

/// Long work of a server, in plain structs: callers need neither gRPC nor Protobuf. What each value
/// means, its unit and its range are in proto/fovea/v1/jobs.proto and ingest.proto.
namespace fovea::client {

enum class JobKind { kIngestFiles, kExport };
enum class JobState { kQueued, kRunning, kDone, kFailed, kCancelled };

/// How a job stands.
struct Job {
  struct Failure {
    std::string file;
    std::string reason;
  };
  std::string id;
  JobKind kind = JobKind::kIngestFiles;
  JobState state = JobState::kQueued;
  std::string dataset;          // that is written or shown
  std::string target;           // exports: their output
  int64_t done = 0, total = 0;  // steps or frames; total 0: not known yet
  int64_t failed = 0;           // steps or frames that could not be made
  std::optional<double> seconds_left;
  std::string now;                    // the file in hand
  std::string message;                // why it failed
  std::vector<Failure> failures;      // the first 1000; List leaves them out
  std::vector<std::string> warnings;  // different ones, at most 100; List leaves them out
  int64_t warning_count = 0;          // of `warnings`, in a List, too
  int64_t created_ms = 0;             // milliseconds since 1970 (UTC)
  std::optional<int64_t> started_ms, ended_ms;

  /// DONE, FAILED or CANCELLED: it stands so for ever.
  [[nodiscard]] bool ended() const {
    return state != JobState::kQueued && state != JobState::kRunning;
  }
};

/// Files below the server's ingest root to a dataset there.
struct IngestRequest {
  enum class OnMissing { kError, kSkip, kHold };
  enum class Registration { kSame, kIndex, kWorld };
  std::string dataset;
  std::vector<std::string> files;
  std::string raw;  // "256x256x225:uint8:le"; empty: the files say what they are
  std::vector<std::string> grids;
  std::string field;  // empty: "density"
  std::optional<double> frames_per_second;
  OnMissing on_missing = OnMissing::kError;
  Registration registration = Registration::kSame;
  std::string wavelet;  // empty: haar
  bool lossless = false;
  std::optional<double> tolerance;  // data units
};

/// A dataset of the server to pictures or a movie below its export root.
struct ExportRequest {
  std::string dataset;
  std::string output;  // 'shot/f.####.png', 'shot.mp4'
  int64_t first = 0;
  std::optional<int64_t> last;  // included; default: the last committed step
  int64_t stride = 1;
  frames::FrameSpec spec;      // its encoding does not count
  std::string animation_json;  // docs/export.md; empty: one frame a step
  std::optional<double> frames_per_second;
  bool overwrite = false;
};

/// False ends the watch.
using OnJob = std::function<bool(const Job&)>;

/// One connection, made by the first call. Errors are the server's, with "server HOST:PORT: " in
/// front: NOT_FOUND for a job that is not there or is another's, FAILED_PRECONDITION from a server
/// that keeps no jobs, PERMISSION_DENIED without the right to write. INTERNAL for what the proto
/// does not promise. Thread-safe.
class JobsClient {
 public:
  static constexpr int64_t kAll = std::numeric_limits<int64_t>::max();

  /// As Client::Connect.
  [[nodiscard]] static StatusOr<std::unique_ptr<JobsClient>> Connect(
      const std::string& address, const Credentials& credentials = {},
      double deadline_seconds = 60);
  virtual ~JobsClient() = default;

  /// Both begin a job, and return at once.
  [[nodiscard]] virtual StatusOr<Job> IngestFiles(const IngestRequest& request) = 0;
  [[nodiscard]] virtual StatusOr<Job> Export(const ExportRequest& request) = 0;
  [[nodiscard]] virtual StatusOr<Job> Get(const std::string& id) = 0;
  /// Newest first, at most `most` (0 or more), asked for page by page.
  [[nodiscard]] virtual StatusOr<std::vector<Job>> List(int64_t most = kAll) = 0;
  /// Tells how the job stands, at once and whenever that changes, until it has ended or it is told
  /// to stop; how it stood last. Goes on where the server goes and comes back within a minute,
  /// once it was there. `go_on`, which may be empty, is asked every 0.2 s while nothing happens.
  [[nodiscard]] virtual StatusOr<Job> Watch(const std::string& id, const OnJob& on_job,
                                            const GoOn& go_on = {}) = 0;
  /// Asks for its end, and returns at once. A job that has ended is left as it is.
  [[nodiscard]] virtual StatusOr<Job> Cancel(const std::string& id) = 0;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_JOBS_CLIENT_H_
