#ifndef SERVICE_SERVER_LISTENER_H_
#define SERVICE_SERVER_LISTENER_H_

#include <vector>

#include "engine/base/status.h"
#include "service/server/descriptor.h"
#include "service/wire/host_port.h"

namespace fovea::server {

/// Bound sockets that connections can be accepted from, non-blocking: one for each address that the
/// host's name stands for.
struct Listener {
  std::vector<Descriptor> sockets;  // at least 1
  wire::HostPort address;           // as asked for, with the port that was given
  bool loopback = false;            // whether only this machine can reach all of them
};

/// Listens on every address of `address.host`, all on one port. "[::]" takes IPv4 as well, where
/// the machine has both. Blocks while a name is looked up. UNAVAILABLE, saying why, if no address
/// can be had.
[[nodiscard]] StatusOr<Listener> Listen(const wire::HostPort& address);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_LISTENER_H_
