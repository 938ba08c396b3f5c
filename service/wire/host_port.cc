#include "service/wire/host_port.h"

#include <charconv>
#include <cstring>

#include <arpa/inet.h>
#include <netinet/in.h>

namespace fovea::wire {
namespace {

/// Names are not looked up: only "localhost" counts as loopback.
bool IsLoopback(const std::string& host) {
  in_addr v4{};
  in6_addr v6{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) {
    return (ntohl(v4.s_addr) >> 24U) == 127;
  }
  if (inet_pton(AF_INET6, host.c_str(), &v6) == 1) {
    return std::memcmp(&v6, &in6addr_loopback, sizeof(v6)) == 0;
  }
  return host == "localhost";
}

}  // namespace

std::string HostPort::ToString() const {
  return host.find(':') == std::string::npos ? fmt::format("{}:{}", host, port)
                                             : fmt::format("[{}]:{}", host, port);
}

StatusOr<HostPort> ParseHostPort(const std::string& text) {
  const size_t colon = text.rfind(':');
  HostPort address;
  if (colon != std::string::npos) {
    address.host = text.substr(0, colon);
    const char* first = text.data() + colon + 1;
    const char* last = text.data() + text.size();
    const auto [end, error] = std::from_chars(first, last, address.port);
    const bool bracketed =
        address.host.size() > 2 && address.host.front() == '[' && address.host.back() == ']';
    if (bracketed) {
      address.host = address.host.substr(1, address.host.size() - 2);
    }
    const bool host_ok =
        !address.host.empty() && (bracketed || address.host.find(':') == std::string::npos);
    if (host_ok && first != last && end == last && error == std::errc() && address.port >= 0 &&
        address.port <= 65535) {
      address.loopback = IsLoopback(address.host);
      return address;
    }
  }
  return InvalidArgument(
      "'{}' is not HOST:PORT with a port of 0 to 65535, e.g. 127.0.0.1:50051 or [::1]:50051", text);
}

}  // namespace fovea::wire
