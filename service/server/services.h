#ifndef SERVICE_SERVER_SERVICES_H_
#define SERVICE_SERVER_SERVICES_H_

#include <atomic>
#include <cstdint>
#include <memory>
#include <string_view>
#include <utility>

#include "engine/base/status.h"
#include "service/access/gate.h"
#include "service/server/call_tracker.h"
#include "service/server/catalogue.h"
#include "service/server/memory_budget.h"
#include "service/server/stream_registry.h"
#include "service/server/work_pool.h"

namespace fovea::server {

/// What all methods of a server share. Every member is thread-safe. Members are destroyed from the
/// last to the first: no work runs any more when what it uses goes.
struct Services {
  Services(std::unique_ptr<Catalogue> datasets, std::unique_ptr<access::Gate> the_gate,
           int64_t reply_bytes, WorkPool::Limits lookup_limits, WorkPool::Limits render_limits)
      : catalogue(std::move(datasets)),
        gate(std::move(the_gate)),
        replies(reply_bytes),
        renders(std::move(render_limits)),
        lookups(std::move(lookup_limits)) {}

  const std::unique_ptr<Catalogue> catalogue;
  const std::unique_ptr<access::Gate> gate;
  CallTracker calls;
  MemoryBudget replies;
  StreamRegistry streams;
  std::atomic<uint64_t> frames_rendered = 0;
  WorkPool renders;
  WorkPool lookups;  // reads metadata, then hands over to `renders`
};

/// The error of a call that comes while the server drains.
[[nodiscard]] Status DrainingError();

/// Logs how a call ended, once: what the client did wrong as information, what the server did
/// wrong as an error.
void LogOutcome(std::string_view method, std::string_view subject, const Status& status,
                double milliseconds);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SERVICES_H_
