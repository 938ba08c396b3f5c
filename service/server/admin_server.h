#ifndef SERVICE_SERVER_ADMIN_SERVER_H_
#define SERVICE_SERVER_ADMIN_SERVER_H_

#include <functional>
#include <memory>
#include <string>

#include "engine/base/status.h"

namespace fovea::server {

/// HTTP/1.1 for those who look after a server: /livez (200 while the process answers), /readyz
/// (200 while calls are taken, else 503), /metrics (Prometheus' text format; 503 before there is
/// anything to tell). Asks nobody who they are. Thread-safe.
class AdminServer {
 public:
  enum class State { kStarting, kReady, kDraining };

  /// Answers when it returns, in the state kStarting. `address` is HOST:PORT, port 0 any free one.
  /// INVALID_ARGUMENT for a bad address, or one that is not loopback without `any_address`;
  /// UNAVAILABLE if it cannot be had.
  [[nodiscard]] static StatusOr<std::unique_ptr<AdminServer>> Start(const std::string& address,
                                                                    bool any_address);
  virtual ~AdminServer() = default;

  /// HOST:PORT, with the port that was given.
  [[nodiscard]] virtual const std::string& address() const = 0;
  virtual void SetState(State state) = 0;
  /// What /metrics sends from now on; called from any thread. An empty one waits until none that
  /// was set before is being called.
  virtual void SetMetrics(std::function<std::string()> text) = 0;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_ADMIN_SERVER_H_
