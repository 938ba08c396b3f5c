#include "service/server/admission.h"

#include <utility>

#include <gtest/gtest.h>

namespace fovea::server {
namespace {

TEST(ClientOfTest, IsTheTokenOrTheAddress) {
  access::Token token;
  const access::Caller everyone(token);
  const std::pair<const char*, const char*> peers[] = {
      {"ipv4:10.1.2.3:4242", "10.1.2.3"},
      {"ipv6:%5B2001:db8:1:2:a3b4:4:5:6%5D:443", "2001:db8:1:2::"},
      {"ipv6:[2001:db8:1:2::9]:443", "2001:db8:1:2::"},
      {"ipv6:%5B::ffff:10.1.2.3%5D:4242", "::ffff:10.1.2.3"},
      {"ipv6:[fe80::1%eth0]:1", "fe80::"},
      {"", ""},
      {"unknown", "unknown"},
  };
  for (const auto& [peer, client] : peers) {
    EXPECT_EQ(ClientOf(everyone, peer), client) << peer;
  }
  token.name = "lab";
  EXPECT_EQ(ClientOf(access::Caller(token), "ipv4:10.1.2.3:4242"), "token:lab");
}

}  // namespace
}  // namespace fovea::server
