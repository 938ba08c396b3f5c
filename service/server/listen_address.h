#ifndef SERVICE_SERVER_LISTEN_ADDRESS_H_
#define SERVICE_SERVER_LISTEN_ADDRESS_H_

#include <string>

#include "engine/base/status.h"

namespace fovea::server {

/// Where a server listens.
struct ListenAddress {
  std::string host;       // a name, an IPv4 address, or an IPv6 address without brackets
  int port = 0;           // 0: any free one
  bool loopback = false;  // whether only this machine can reach it
  /// "HOST:PORT", an IPv6 address in brackets.
  [[nodiscard]] std::string ToString() const;
};

/// Reads HOST:PORT, e.g. "127.0.0.1:50051", "localhost:0", "[::1]:50051". INVALID_ARGUMENT.
[[nodiscard]] StatusOr<ListenAddress> ParseListenAddress(const std::string& text);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_LISTEN_ADDRESS_H_
