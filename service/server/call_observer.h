#ifndef SERVICE_SERVER_CALL_OBSERVER_H_
#define SERVICE_SERVER_CALL_OBSERVER_H_

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_interceptor.h>

#include "service/server/metrics.h"

namespace fovea::server {

class ObservedCall;

/// Sees every call of a server from its arrival to its end, whatever service it is of: counts it
/// (Metrics), logs it (LogCall), and gives it a random id, which its client gets as trailing
/// metadata `fovea-request-id`. It sits in gRPC as an interceptor, so no method can forget it.
/// Thread-safe; must outlive the server's calls.
class CallObserver {
 public:
  explicit CallObserver(Metrics& metrics) : metrics_(metrics) {}

  /// For grpc::ServerBuilder::experimental().SetInterceptorCreators.
  [[nodiscard]] std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> Factory();

  /// Who makes the running call of `context`, and about what: for its line in the log.
  void Describe(const grpc::ServerContextBase& context, const std::string& client,
                const std::string& dataset);

  /// From now on the server ends calls itself: a cancelled one is not its client's doing.
  void CutShort() { cutting_short_ = true; }

 private:
  friend class ObservedCall;

  Metrics& metrics_;
  std::atomic<bool> cutting_short_ = false;
  std::mutex mutex_;
  std::unordered_map<const grpc::ServerContextBase*, ObservedCall*> running_;  // guarded by mutex_
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_CALL_OBSERVER_H_
