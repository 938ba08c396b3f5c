#ifndef SERVICE_SERVER_ACCEPTOR_H_
#define SERVICE_SERVER_ACCEPTOR_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "engine/base/status.h"
#include "service/server/connection_table.h"
#include "service/server/descriptor.h"

namespace fovea::server {

/// Accepts connections in a thread of its own and hands them on. It stands in front of gRPC's own
/// loop, which in 1.51 never accepts again once the process has run out of descriptors: here a
/// spare one is closed then, so that the connection can be taken and closed, and its client knows.
/// Counts what it turned away; logs it at most every ten seconds. Thread-safe.
class Acceptor {
 public:
  /// Gets a connected, non-blocking socket, and owns it. Called from the acceptor's thread.
  using OnConnection = std::function<void(int listening_fd, int fd)>;
  struct Counts {
    uint64_t accepted = 0;
    uint64_t over_total = 0;          // closed at once for a limit of the table
    uint64_t over_address = 0;        // likewise
    uint64_t out_of_descriptors = 0;  // closed at once for want of a descriptor
  };

  /// RESOURCE_EXHAUSTED if not even the spare descriptors can be had.
  [[nodiscard]] static StatusOr<std::unique_ptr<Acceptor>> Start(std::vector<Descriptor> listeners,
                                                                 ConnectionTable::Limits limits,
                                                                 OnConnection on_connection);
  /// Stops accepting; when it returns, `on_connection` is not called any more.
  ~Acceptor();
  Acceptor(const Acceptor&) = delete;
  Acceptor& operator=(const Acceptor&) = delete;

  [[nodiscard]] Counts counts() const;
  /// Connections that are open now. Asks the kernel about each.
  [[nodiscard]] int CountOpen();

 private:
  Acceptor(std::vector<Descriptor> listeners, ConnectionTable::Limits limits,
           OnConnection on_connection);

  void Run();
  void AcceptAll(int listener);
  void Take(int listener, int fd, const sockaddr_storage& peer);
  /// Takes one waiting connection and closes it, with the spare descriptor in its place. False if
  /// another thread got hold of that one first.
  bool Shed(int listener);
  void LogTurnedAway();

  const std::vector<Descriptor> listeners_;
  const OnConnection on_connection_;
  const Descriptor wake_;  // readable when the thread is to stop
  std::atomic<uint64_t> accepted_ = 0, over_total_ = 0, over_address_ = 0, out_of_descriptors_ = 0;
  std::mutex table_mutex_;
  ConnectionTable table_;  // guarded by table_mutex_
  // The thread's own.
  Descriptor spare_;
  Counts logged_;
  std::chrono::steady_clock::time_point logged_at_;
  std::thread thread_;
};

/// Raises the limit on open descriptors as far as the system lets this process; returns it.
int64_t RaiseDescriptorLimit();

}  // namespace fovea::server

#endif  // SERVICE_SERVER_ACCEPTOR_H_
