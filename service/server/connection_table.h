#ifndef SERVICE_SERVER_CONNECTION_TABLE_H_
#define SERVICE_SERVER_CONNECTION_TABLE_H_

#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <unordered_map>

namespace fovea::server {

/// Which accepted connections are open, and from where, though whoever serves them closes them
/// without a word. The kernel is asked: each socket has a cookie, which no other socket gets while
/// the machine runs, so a descriptor stands for the connection it was for as long as it has that
/// cookie. It is asked only when a limit seems to be reached, and a descriptor that comes again
/// says by itself that its last connection is gone. Not thread-safe.
class ConnectionTable {
 public:
  struct Limits {
    int total = 1;        // at least 1
    int per_address = 1;  // at least 1; of one IPv4 address, or of one /64 of IPv6
  };
  enum class Verdict { kAdmitted, kOverTotal, kOverAddress };

  explicit ConnectionTable(Limits limits) : limits_(limits) {}

  /// Remembers the connection `fd` from `peer`, unless there are too many. Closes nothing.
  [[nodiscard]] Verdict Add(int fd, const sockaddr_storage& peer);
  /// How many are open now. Asks the kernel about each.
  [[nodiscard]] int CountOpen();

 private:
  /// An IPv4 address as IPv6 writes it, or the first half of an IPv6 address: a site has all of
  /// the second half.
  using Address = std::array<uint8_t, 16>;
  struct Connection {
    uint64_t cookie = 0;
    Address address{};
  };

  [[nodiscard]] static Address AddressOf(const sockaddr_storage& peer);
  [[nodiscard]] int CountOpen(const Address& address);
  [[nodiscard]] bool IsOpen(int fd) const;
  void Forget(int fd);

  const Limits limits_;
  std::unordered_map<int, Connection> connections_;  // by descriptor
  std::map<Address, std::set<int>> by_address_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_CONNECTION_TABLE_H_
