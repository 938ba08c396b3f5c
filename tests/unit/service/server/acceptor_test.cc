#include "service/server/acceptor.h"

#include <sys/socket.h>
#include <unistd.h>

#include <future>
#include <utility>
#include <vector>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include "service/server/listener.h"
#include "tests/support/status_matchers.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

Descriptor ConnectTo(int port, bool v6 = false) {
  Descriptor socket(::socket(v6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in to4{};
  to4.sin_family = AF_INET;
  to4.sin_port = htons(static_cast<uint16_t>(port));
  to4.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  sockaddr_in6 to6{};
  to6.sin6_family = AF_INET6;
  to6.sin6_port = to4.sin_port;
  to6.sin6_addr = in6addr_loopback;
  const auto* to = v6 ? reinterpret_cast<sockaddr*>(&to6) : reinterpret_cast<sockaddr*>(&to4);
  if (connect(socket.get(), to, v6 ? sizeof(to6) : sizeof(to4)) != 0) {
    socket.Close();
  }
  return socket;
}

/// Whether the other side has closed; waits until it has, or has sent something.
bool IsClosed(const Descriptor& socket) {
  char byte = 0;
  return recv(socket.get(), &byte, 1, 0) <= 0;
}

/// Says hello to all it accepts.
std::unique_ptr<Acceptor> Greeter(Listener listener, ConnectionTable::Limits limits,
                                  std::vector<Descriptor>* taken) {
  auto acceptor = Acceptor::Start(std::move(listener.sockets), limits, [taken](int, int fd) {
    EXPECT_EQ(send(fd, "!", 1, 0), 1);
    taken->emplace_back(fd);
  });
  EXPECT_OK(acceptor.status());
  return *std::move(acceptor);
}

TEST(AcceptorTest, HandsOnAndClosesWhatIsAboveTheLimit) {
  std::vector<Descriptor> taken;
  ASSERT_OK_AND_ASSIGN(Listener listener, Listen({"127.0.0.1", 0, true}));
  const int port = listener.address.port;
  EXPECT_GT(port, 0);
  EXPECT_TRUE(listener.loopback);
  auto acceptor = Greeter(std::move(listener), {.total = 9, .per_address = 2}, &taken);
  const Descriptor one = ConnectTo(port);
  const Descriptor two = ConnectTo(port);
  EXPECT_FALSE(IsClosed(one));
  EXPECT_FALSE(IsClosed(two));
  EXPECT_TRUE(IsClosed(ConnectTo(port)));
  EXPECT_EQ(acceptor->counts().accepted, 2U);
  EXPECT_EQ(acceptor->counts().over_address, 1U);
  EXPECT_EQ(acceptor->counts().over_total, 0U);
  acceptor.reset();
  EXPECT_FALSE(ConnectTo(port).valid());
}

TEST(AcceptorTest, SurvivesHavingNoDescriptorsLeft) {
  std::vector<Descriptor> taken;
  ASSERT_OK_AND_ASSIGN(Listener listener, Listen({"127.0.0.1", 0, true}));
  const int port = listener.address.port;
  const auto acceptor = Greeter(std::move(listener), {.total = 99, .per_address = 99}, &taken);
  std::vector<Descriptor> clients(3);
  for (Descriptor& client : clients) {  // before there are no descriptors for them, either
    client = Descriptor(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  }
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  {
    std::vector<Descriptor> all;
    do {
      all.emplace_back(dup(0));
    } while (all.back().valid());
    for (const Descriptor& client : clients) {
      ASSERT_EQ(connect(client.get(), reinterpret_cast<sockaddr*>(&to), sizeof(to)), 0);
      EXPECT_TRUE(IsClosed(client));
    }
    EXPECT_EQ(acceptor->counts().out_of_descriptors, 3U);
  }
  EXPECT_FALSE(IsClosed(ConnectTo(port)));
}

TEST(ListenerTest, KnowsWhoCanReachIt) {
  ASSERT_OK_AND_ASSIGN(const Listener all, Listen({"0.0.0.0", 0, false}));
  EXPECT_FALSE(all.loopback);
  ASSERT_OK_AND_ASSIGN(const Listener named, Listen({"localhost", 0, true}));
  EXPECT_TRUE(named.loopback);
  EXPECT_GT(named.address.port, 0);
}

TEST(ListenerTest, SaysWhyNot) {
  ASSERT_OK_AND_ASSIGN(const Listener one, Listen({"127.0.0.1", 0, true}));
  EXPECT_THAT(Listen(one.address), FailsWith(absl::StatusCode::kUnavailable, "port is taken"));
  EXPECT_THAT(Listen({"192.0.2.1", 0, false}),
              FailsWith(absl::StatusCode::kUnavailable, "not this machine's"));
}

TEST(ListenerTest, Ipv6) {
  auto listener = Listen({"::1", 0, true});
  if (!listener.ok()) {
    GTEST_SKIP() << "this machine has no IPv6: " << MessageOf(listener.status());
  }
  EXPECT_TRUE(listener->loopback);
  EXPECT_EQ(listener->address.ToString().substr(0, 6), "[::1]:");
  std::vector<Descriptor> taken;
  const int port = listener->address.port;
  const auto acceptor = Greeter(*std::move(listener), {.total = 9, .per_address = 1}, &taken);
  const Descriptor one = ConnectTo(port, true);
  EXPECT_FALSE(IsClosed(one));
  EXPECT_TRUE(IsClosed(ConnectTo(port, true)));
}

}  // namespace
}  // namespace fovea::server
