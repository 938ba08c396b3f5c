#ifndef SERVICE_SERVER_SERVER_H_
#define SERVICE_SERVER_SERVER_H_

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "engine/base/status.h"
#include "service/server/certificates.h"

/// The gRPC service over the datasets below one directory.
namespace fovea::server {

struct ServerOptions {
  std::string root;                        // holds the datasets
  std::string listen = "127.0.0.1:50051";  // HOST:PORT; port 0: any free one
  std::string admin;                       // HOST:PORT of the admin port; empty: none
  bool admin_any_address = false;          // allows one that other machines can reach
  bool insecure_plaintext = false;         // allows addresses that other machines can reach
  CertificateFiles tls;                    // given: TLS, else plaintext
  bool allow_ingest = false;               // without tokens everyone may write, or nobody
  std::string state;                       // folder of jobs; empty: none are kept
  std::string ingest_root, export_root;    // of jobs; empty: no such jobs
  int jobs = 1;                            // that run at once
  std::string tokens;                      // file of access::ReadTokenFile; empty: no tokens asked
  std::string memory_limit = "50%";        // of the whole process: ParseMemoryLimit
  int threads = 0;                         // that render; 0: all processors
  int render_queue = 64;                   // frames that may wait to be rendered
  int max_connections = 0;  // 0: 1000, or half of the descriptors the process may open if fewer
  int max_connections_per_address = 250;
  std::chrono::milliseconds rescan_interval{1000};  // between looks for new datasets and steps
  std::chrono::milliseconds reload_interval{1000};  // between looks at `tls`, `tokens`
};

/// A running server. Thread-safe.
class Server {
 public:
  /// Serves when it returns. INVALID_ARGUMENT for a bad address, or one that is not loopback
  /// without `insecure_plaintext`; NOT_FOUND, FAILED_PRECONDITION for the root; UNAVAILABLE if the
  /// address cannot be had.
  [[nodiscard]] static StatusOr<std::unique_ptr<Server>> Start(const ServerOptions& options);
  /// Cancels what runs and stops.
  virtual ~Server() = default;

  /// HOST:PORT, with the port that was given.
  [[nodiscard]] virtual const std::string& address() const = 0;
  /// HOST:PORT of the admin port; empty if there is none.
  [[nodiscard]] virtual std::string admin_address() const = 0;
  [[nodiscard]] virtual size_t dataset_count() const = 0;
  /// Frames rendered since the start, sent or not.
  [[nodiscard]] virtual uint64_t frames_rendered() const = 0;

  /// Reports NOT_SERVING, and serves on: balancers have time to notice before Drain.
  virtual void SayNotReady() = 0;
  /// Reports NOT_SERVING, refuses new calls with UNAVAILABLE, lets running ones finish for at most
  /// `limit`, cancels the rest, and stops. Returns how many were cancelled.
  virtual int64_t Drain(std::chrono::milliseconds limit) = 0;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_SERVER_H_
