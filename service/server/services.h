#ifndef SERVICE_SERVER_SERVICES_H_
#define SERVICE_SERVER_SERVICES_H_

#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>

#include "engine/base/status.h"
#include "service/access/gate.h"
#include "service/jobs/job_runner.h"
#include "service/server/call_observer.h"
#include "service/server/call_tracker.h"
#include "service/server/catalogue.h"
#include "service/server/memory_budget.h"
#include "service/server/metrics.h"
#include "service/server/step_feed.h"
#include "service/server/stream_registry.h"
#include "service/server/timer.h"
#include "service/server/work_pool.h"

namespace fovea::server {

/// What all methods of a server share. Every member is thread-safe. Members are destroyed from the
/// last to the first: no work runs any more when what it uses goes.
struct Services {
  /// They wait for the disk most of the time.
  static constexpr int kIngestThreads = 4;

  Services(std::unique_ptr<Catalogue> datasets, std::unique_ptr<access::Gate> the_gate,
           int64_t reply_bytes, WorkPool::Limits lookup_limits, WorkPool::Limits render_limits,
           bool may_write = false, int64_t request_bytes = INT64_MAX)
      : catalogue(std::move(datasets)),
        gate(std::move(the_gate)),
        writable(may_write),
        requests(request_bytes),
        replies(reply_bytes),
        steps(*catalogue, StepFeed::kInterval, StepFeed::kAbsentInterval),
        renders(std::move(render_limits)),
        lookups(std::move(lookup_limits)),
        ingests({.name = "ingest queue", .flag = "", .threads = kIngestThreads}) {}

  const std::unique_ptr<Catalogue> catalogue;
  const std::unique_ptr<access::Gate> gate;
  const bool writable;                    // whether anyone may change datasets
  std::unique_ptr<jobs::JobRunner> jobs;  // null: none are kept; not changed once calls come
  Metrics metrics;
  CallObserver observer{metrics};
  CallTracker calls;
  MemoryBudget requests;  // of calls that run
  MemoryBudget replies;   // being made or sent
  StreamRegistry streams;
  StepFeed steps;  // tells of what is committed
  std::atomic<uint64_t> frames_rendered = 0;
  std::atomic<int> live_streams = 0;  // that write readings
  WorkPool renders;
  WorkPool lookups;  // reads metadata, then hands over to `renders`
  WorkPool ingests;  // sorts readings and commits steps
  Timer timer;       // for streams that are held back, or look after themselves
};

/// The error of a call that comes while the server drains.
[[nodiscard]] Status DrainingError();

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SERVICES_H_
