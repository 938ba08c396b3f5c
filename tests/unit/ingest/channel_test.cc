#include "ingest/channel.h"

#include <sys/socket.h>

#include <random>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;

std::string Payload(size_t size, unsigned seed) {
  std::mt19937 random(seed);
  std::string payload(size, '\0');
  for (char& byte : payload) {
    byte = static_cast<char>(random());
  }
  return payload;
}

TEST(ChannelTest, FramesOfAllSizesArriveAsTheyWereSent) {
  int sockets[2];
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets), 0);
  Channel receiver(sockets[0]);
  // Around the size of the receiver's buffer, and small ones between them that share a recv.
  const size_t sizes[] = {0,     1,       262136,           7, 262137, 262144,
                          100,   1 << 20, (1 << 20) + 1,    3, 3,      3,
                          65536, 199999,  kMaxPayloadBytes, 5};
  std::thread sender([&] {
    Channel channel(sockets[1]);
    unsigned seed = 0;
    for (const size_t size : sizes) {
      ASSERT_OK(channel.Send({FrameKind::kBytes, Payload(size, ++seed)}, Channel::kNoDeadline));
    }
    ASSERT_OK(channel.Flush(Channel::kNoDeadline));
  });
  unsigned seed = 0;
  for (const size_t size : sizes) {
    const auto frame = receiver.Receive(Channel::kNoDeadline);
    EXPECT_TRUE(frame.ok() && frame->payload == Payload(size, ++seed)) << size;
  }
  sender.join();
  EXPECT_THAT(receiver.Receive(Channel::kNoDeadline),
              FailsWith(absl::StatusCode::kUnavailable, "gone"));
}

}  // namespace
}  // namespace fovea::ingest
