#include "service/server/connection_table.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <vector>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include "service/server/descriptor.h"

namespace fovea::server {
namespace {

using Verdict = ConnectionTable::Verdict;

sockaddr_storage Peer(const std::string& address) {
  sockaddr_storage peer{};
  auto& v4 = reinterpret_cast<sockaddr_in&>(peer);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(peer);
  if (inet_pton(AF_INET, address.c_str(), &v4.sin_addr) == 1) {
    v4.sin_family = AF_INET;
  } else {
    EXPECT_EQ(inet_pton(AF_INET6, address.c_str(), &v6.sin6_addr), 1) << address;
    v6.sin6_family = AF_INET6;
  }
  return peer;
}

Descriptor Socket() {
  return Descriptor(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
}

class ConnectionTableTest : public ::testing::Test {
 protected:
  /// A new connection from `address`, kept open if it is admitted.
  Verdict Connect(ConnectionTable& table, const std::string& address) {
    Descriptor socket = Socket();
    const Verdict verdict = table.Add(socket.get(), Peer(address));
    if (verdict == Verdict::kAdmitted) {
      open_.push_back(std::move(socket));
    }
    return verdict;
  }

  std::vector<Descriptor> open_;
};

TEST_F(ConnectionTableTest, AnAddressHasItsShareUntilOneIsClosed) {
  ConnectionTable table({.total = 100, .per_address = 2});
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kOverAddress);
  EXPECT_EQ(Connect(table, "10.0.0.2"), Verdict::kAdmitted);
  open_.erase(open_.begin());
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kOverAddress);
}

TEST_F(ConnectionTableTest, AllTogetherHaveALimit) {
  ConnectionTable table({.total = 3, .per_address = 2});
  for (const char* address : {"10.0.0.1", "10.0.0.2", "10.0.0.3"}) {
    EXPECT_EQ(Connect(table, address), Verdict::kAdmitted);
  }
  EXPECT_EQ(Connect(table, "10.0.0.4"), Verdict::kOverTotal);
  open_.pop_back();
  EXPECT_EQ(table.CountOpen(), 2);
  EXPECT_EQ(Connect(table, "10.0.0.4"), Verdict::kAdmitted);
}

TEST_F(ConnectionTableTest, AddressesAreSitesOfIpv6AndHostsOfIpv4HoweverWritten) {
  ConnectionTable table({.total = 100, .per_address = 1});
  EXPECT_EQ(Connect(table, "2001:db8:1:2::1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "2001:db8:1:2:ffff::9"), Verdict::kOverAddress);
  EXPECT_EQ(Connect(table, "2001:db8:1:3::1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "::ffff:10.0.0.1"), Verdict::kOverAddress);
  EXPECT_EQ(Connect(table, "::ffff:10.0.0.2"), Verdict::kAdmitted);
}

TEST_F(ConnectionTableTest, ADescriptorThatBecameAnotherFileOrSocketIsNoConnection) {
  ConnectionTable table({.total = 100, .per_address = 2});
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kAdmitted);
  EXPECT_EQ(Connect(table, "10.0.0.1"), Verdict::kAdmitted);
  const int file = open("/dev/null", O_RDONLY | O_CLOEXEC);
  ASSERT_EQ(dup2(file, open_[0].get()), open_[0].get());
  EXPECT_EQ(table.CountOpen(), 1);
  close(file);
  ASSERT_EQ(dup2(Socket().get(), open_[1].get()), open_[1].get());
  EXPECT_EQ(table.CountOpen(), 0);
}

TEST_F(ConnectionTableTest, ADescriptorThatComesAgainReplacesItsLastConnection) {
  ConnectionTable table({.total = 1, .per_address = 1});
  Descriptor socket = Socket();
  EXPECT_EQ(table.Add(socket.get(), Peer("10.0.0.1")), Verdict::kAdmitted);
  EXPECT_EQ(table.Add(socket.get(), Peer("10.0.0.2")), Verdict::kAdmitted);
  EXPECT_EQ(table.CountOpen(), 1);
  Descriptor other = Socket();
  EXPECT_EQ(table.Add(other.get(), Peer("10.0.0.1")), Verdict::kOverTotal);
}

}  // namespace
}  // namespace fovea::server
