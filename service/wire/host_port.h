#ifndef SERVICE_WIRE_HOST_PORT_H_
#define SERVICE_WIRE_HOST_PORT_H_

#include <string>

#include "engine/base/status.h"

namespace fovea::wire {

/// Where a server listens, or is found.
struct HostPort {
  std::string host;       // a name, an IPv4 address, or an IPv6 address without brackets
  int port = 0;           // 0: any free one
  bool loopback = false;  // whether only this machine can reach it
  /// "HOST:PORT", an IPv6 address in brackets.
  [[nodiscard]] std::string ToString() const;
};

/// Reads HOST:PORT, e.g. "127.0.0.1:50051", "localhost:0", "[::1]:50051". INVALID_ARGUMENT.
[[nodiscard]] StatusOr<HostPort> ParseHostPort(const std::string& text);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_HOST_PORT_H_
