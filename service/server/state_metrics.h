#ifndef SERVICE_SERVER_STATE_METRICS_H_
#define SERVICE_SERVER_STATE_METRICS_H_

#include <vector>

#include <prometheus/metric_family.h>

#include "service/server/acceptor.h"
#include "service/server/services.h"

namespace fovea::server {

/// What a server has at this moment, and what its parts counted: queues, memory, connections, and
/// the process itself (docs/operations.md lists the names). Thread-safe.
[[nodiscard]] std::vector<prometheus::MetricFamily> StateMetrics(Services& services,
                                                                 Acceptor& acceptor);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_STATE_METRICS_H_
