#include "service/server/connection_table.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <vector>

#include <netinet/in.h>

namespace fovea::server {
namespace {

constexpr size_t kSitePrefixBytes = 8;

/// Empty if `fd` is no open socket.
std::optional<uint64_t> CookieOf(int fd) {
  uint64_t cookie = 0;
  socklen_t size = sizeof(cookie);
  if (getsockopt(fd, SOL_SOCKET, SO_COOKIE, &cookie, &size) != 0) {
    return std::nullopt;
  }
  return cookie;
}

}  // namespace

ConnectionTable::Address ConnectionTable::AddressOf(const sockaddr_storage& peer) {
  Address address{};
  if (peer.ss_family == AF_INET) {
    address[10] = address[11] = 0xFF;
    std::memcpy(&address[12], &reinterpret_cast<const sockaddr_in&>(peer).sin_addr, 4);
  } else if (peer.ss_family == AF_INET6) {
    const in6_addr& v6 = reinterpret_cast<const sockaddr_in6&>(peer).sin6_addr;
    std::memcpy(address.data(), &v6, IN6_IS_ADDR_V4MAPPED(&v6) ? address.size() : kSitePrefixBytes);
  }
  return address;
}

ConnectionTable::Verdict ConnectionTable::Add(int fd, const sockaddr_storage& peer) {
  Forget(fd);
  const Address address = AddressOf(peer);
  const auto same = by_address_.find(address);
  if (same != by_address_.end() && static_cast<int>(same->second.size()) >= limits_.per_address &&
      CountOpen(address) >= limits_.per_address) {
    return Verdict::kOverAddress;
  }
  if (static_cast<int>(connections_.size()) >= limits_.total && CountOpen() >= limits_.total) {
    return Verdict::kOverTotal;
  }
  connections_[fd] = {CookieOf(fd).value_or(0), address};
  by_address_[address].insert(fd);
  return Verdict::kAdmitted;
}

int ConnectionTable::CountOpen() {
  std::vector<int> closed;
  for (const auto& [fd, connection] : connections_) {
    if (!IsOpen(fd)) {
      closed.push_back(fd);
    }
  }
  for (const int fd : closed) {
    Forget(fd);
  }
  return static_cast<int>(connections_.size());
}

int ConnectionTable::CountOpen(const Address& address) {
  const std::set<int> fds = by_address_[address];
  for (const int fd : fds) {
    if (!IsOpen(fd)) {
      Forget(fd);
    }
  }
  const auto left = by_address_.find(address);
  return left == by_address_.end() ? 0 : static_cast<int>(left->second.size());
}

bool ConnectionTable::IsOpen(int fd) const {
  const auto found = connections_.find(fd);
  return found != connections_.end() && CookieOf(fd) == found->second.cookie;
}

void ConnectionTable::Forget(int fd) {
  const auto found = connections_.find(fd);
  if (found == connections_.end()) {
    return;
  }
  const auto same = by_address_.find(found->second.address);
  same->second.erase(fd);
  if (same->second.empty()) {
    by_address_.erase(same);
  }
  connections_.erase(found);
}

}  // namespace fovea::server
