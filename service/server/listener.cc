#include "service/server/listener.h"

#include <sys/socket.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <string>
#include <system_error>
#include <utility>

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>

namespace fovea::server {
namespace {

constexpr int kBacklog = 1024;  // connections that wait to be accepted
/// What a peer may leave unacknowledged before its connection is given up, ms.
constexpr int kUserTimeoutMs = 20'000;

bool IsLoopback(const sockaddr& address) {
  if (address.sa_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    return (ntohl(v4.sin_addr.s_addr) >> 24U) == 127;
  }
  const auto& v6 = reinterpret_cast<const sockaddr_in6&>(address);
  return std::memcmp(&v6.sin6_addr, &in6addr_loopback, sizeof(v6.sin6_addr)) == 0;
}

std::string Reason(int error) {
  switch (error) {
    case EADDRINUSE:
      return "the port is taken";
    case EADDRNOTAVAIL:
      return "the address is not this machine's";
    case EACCES:
      return "ports below 1024 are for root";
    default:
      return std::generic_category().message(error);
  }
}

void SetPort(sockaddr* address, int port) {
  const auto in_network_order = htons(static_cast<uint16_t>(port));
  if (address->sa_family == AF_INET) {
    reinterpret_cast<sockaddr_in*>(address)->sin_port = in_network_order;
  } else {
    reinterpret_cast<sockaddr_in6*>(address)->sin6_port = in_network_order;
  }
}

int PortOf(int socket) {
  sockaddr_storage bound{};
  socklen_t size = sizeof(bound);
  getsockname(socket, reinterpret_cast<sockaddr*>(&bound), &size);
  return ntohs(bound.ss_family == AF_INET ? reinterpret_cast<sockaddr_in&>(bound).sin_port
                                          : reinterpret_cast<sockaddr_in6&>(bound).sin6_port);
}

/// What accepted sockets inherit, too. Errors are left: none of it is needed to serve.
void SetOptions(int socket, int family) {
  const auto set = [socket](int level, int option, int value) {
    static_cast<void>(setsockopt(socket, level, option, &value, sizeof(value)));
  };
  set(SOL_SOCKET, SO_REUSEADDR, 1);  // a restart need not wait for the old connections' TIME_WAIT
  set(IPPROTO_TCP, TCP_NODELAY, 1);
  set(IPPROTO_TCP, TCP_USER_TIMEOUT, kUserTimeoutMs);
  if (family == AF_INET6) {
    set(IPPROTO_IPV6, IPV6_V6ONLY, 0);
  }
}

/// A bound, listening socket, or errno.
std::pair<Descriptor, int> Bind(const sockaddr& address, socklen_t size) {
  Descriptor socket(::socket(address.sa_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!socket.valid()) {
    return {Descriptor(), errno};
  }
  SetOptions(socket.get(), address.sa_family);
  if (bind(socket.get(), &address, size) != 0 || listen(socket.get(), kBacklog) != 0) {
    return {Descriptor(), errno};
  }
  return {std::move(socket), 0};
}

using AddressList = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

StatusOr<AddressList> Resolve(const wire::HostPort& address) {
  addrinfo hints{};
  hints.ai_flags = AI_PASSIVE;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int error =
      getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found);
  if (error != 0) {
    return Unavailable("cannot listen on {}: {}; give an address of this machine with --listen",
                       address.ToString(), gai_strerror(error));
  }
  return AddressList(found, freeaddrinfo);
}

}  // namespace

StatusOr<Listener> Listen(const wire::HostPort& address) {
  FOVEA_ASSIGN_OR_RETURN(const AddressList addresses, Resolve(address));
  Listener listener;
  listener.address = address;
  listener.loopback = true;
  int failed = EADDRNOTAVAIL;
  for (addrinfo* at = addresses.get(); at != nullptr; at = at->ai_next) {
    if (at->ai_family != AF_INET && at->ai_family != AF_INET6) {
      continue;
    }
    SetPort(at->ai_addr, listener.address.port);
    auto [socket, error] = Bind(*at->ai_addr, at->ai_addrlen);
    if (!socket.valid()) {
      failed = error;
      if (error == EADDRINUSE) {
        break;  // half of a name's addresses would be another program's
      }
      continue;
    }
    failed = 0;
    listener.address.port = PortOf(socket.get());
    listener.loopback = listener.loopback && IsLoopback(*at->ai_addr);
    listener.sockets.push_back(std::move(socket));
  }
  if (listener.sockets.empty() || failed == EADDRINUSE) {
    return Unavailable(
        "cannot listen on {}: {}; choose another with --listen (port 0 takes any free one)",
        address.ToString(), Reason(failed));
  }
  return listener;
}

}  // namespace fovea::server
