#ifndef INGEST_WORKER_CLIENT_H_
#define INGEST_WORKER_CLIENT_H_

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/ingest.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

struct WorkerOptions {
  WorkerLimits limits;
  /// The most bytes that one grid or file declares to need in memory.
  int64_t declared_bytes = 0;
  std::string program;  // empty: the worker's, where FindProgram finds it
  /// Whether the process goes with the thread that started it, not only with the client.
  bool dies_with_thread = true;
  /// All that the worker may read; Allow adds to it.
  std::vector<std::string> files;
  /// Whether it needs OpenImageIO, which takes most of a second to load.
  bool pictures = false;
  /// Whether it needs OpenVDB, which takes longer to load than a small volume to read: then the
  /// program is fovea-vdb-worker, else fovea-worker.
  bool openvdb = false;
};

/// The memory limit of a worker: as asked for, else 512 MB + 3 x the declared bytes, at most what
/// the machine has. 0: no limit (programs built with sanitizers reserve far more than they use).
[[nodiscard]] int64_t WorkerMemoryBytes(const WorkerOptions& options);

/// A worker process, started at the first call and again after it died; it goes with the client.
/// One thread at a time.
class WorkerClient {
 public:
  explicit WorkerClient(WorkerOptions options) : options_(std::move(options)) {}
  ~WorkerClient() { Stop(); }
  WorkerClient(const WorkerClient&) = delete;
  WorkerClient& operator=(const WorkerClient&) = delete;

  /// Starts a worker and does not wait until it is ready: the next call does. What goes wrong is
  /// told then.
  void Prepare();
  /// Whether one for `options` would be started as this one was, but for files and a memory limit
  /// that is no higher.
  [[nodiscard]] bool Suits(const WorkerOptions& options) const;

  /// Sends `request`, with `attachment` in pieces behind it, and gives each reply to `on_reply`, up
  /// to the end of the answer. Every error begins with `about`, the file in question: what the
  /// worker says; DATA_LOSS with the signal if it died; DEADLINE_EXCEEDED if it took longer than
  /// its time, after which it is killed; what `on_reply` returns, after which it is stopped;
  /// INTERNAL if it speaks nonsense.
  [[nodiscard]] Status Call(const std::string& about, const Frame& request,
                            std::string_view attachment,
                            const std::function<Status(const FrameView&)>& on_reply);

  /// Files that the next calls may read. A worker is confined for good when it starts
  /// (ingest/worker/sandbox.h), so one that does not know a file, or knew another of that name, is
  /// replaced: name as many as are known in WorkerOptions::files.
  void Allow(const std::vector<std::string>& files);

  /// What the worker shares (slab_ring.h), in on_reply; null if nothing.
  [[nodiscard]] SlabRing* slabs() const {
    return channel_ == nullptr ? nullptr : channel_->slabs();
  }
  /// In on_reply: time that it waited for something else than the worker.
  void Excuse(std::chrono::steady_clock::duration waited) { deadline_ += waited; }

  /// Starts a worker, if none runs, and says how it is confined. Fails as Call does.
  [[nodiscard]] StatusOr<Hello> Greet();

  /// Stops the worker, if no further call is to come: to be rid of it takes some milliseconds.
  void Dismiss() { Stop(); }

  /// From any thread: kills the worker, so that the call in hand ends with an error.
  void Interrupt();
  /// The process, or 0.
  [[nodiscard]] pid_t pid() const;

 private:
  /// Which file a name stands for; all zero: none.
  struct FileIdentity {
    dev_t device = 0;
    ino_t number = 0;
    friend bool operator==(const FileIdentity&, const FileIdentity&) = default;
  };
  [[nodiscard]] static FileIdentity Identify(const std::string& path);
  [[nodiscard]] Status Introduce(Channel::Deadline deadline);
  [[nodiscard]] Status ReceiveHello(Channel::Deadline deadline);
  /// Starts a worker if none runs, and waits until it is ready.
  [[nodiscard]] Status MakeReady(Channel::Deadline deadline);
  [[nodiscard]] Channel::Deadline NewDeadline() const;
  /// What a call failed of, for people; the worker is stopped.
  [[nodiscard]] Status GiveUp(const Status& status);
  [[nodiscard]] Status Start(Channel::Deadline deadline);
  [[nodiscard]] Status Exchange(const Frame& request, std::string_view attachment,
                                const std::function<Status(const FrameView&)>& on_reply,
                                bool* is_clean);
  /// Gives a reply out; of a slab, the worker hears that it may fill it again.
  [[nodiscard]] Status HandOut(const FrameView& reply,
                               const std::function<Status(const FrameView&)>& on_reply);
  [[nodiscard]] Status DescribeDeath();
  [[nodiscard]] std::string OrShortOfMemory() const;
  void ForgetIfDead();
  void Stop();
  pid_t TakePid();

  WorkerOptions options_;
  std::unique_ptr<Channel> channel_;
  Channel::Deadline deadline_;                              // of the call in hand
  std::unordered_map<std::string, FileIdentity> readable_;  // for the worker that runs
  std::string program_;                                     // of it
  bool is_ready_ = false;                                   // hello_ came
  Hello hello_;                                             // of it
  mutable std::mutex pid_mutex_;
  pid_t pid_ = 0;  // guarded by pid_mutex_
};

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_CLIENT_H_
