#include "service/server/memory_plan.h"

#include <utility>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

constexpr int64_t kMiB = int64_t{1} << 20;

TEST(MemoryPlanTest, ThePartsAddUpToTheLimit) {
  for (const int64_t limit : {512 * kMiB, 700 * kMiB + 13, 4096 * kMiB, int64_t{1} << 44}) {
    ASSERT_OK_AND_ASSIGN(const MemoryPlan plan, MemoryPlan::Divide(limit));
    EXPECT_EQ(plan.program + plan.transport + plan.requests + plan.replies + plan.rendering +
                  plan.volumes,
              limit);
    for (const int64_t part : {plan.program, plan.transport, plan.requests, plan.replies,
                               plan.rendering, plan.volumes}) {
      EXPECT_GE(part, 32 * kMiB);
    }
  }
  EXPECT_THAT(MemoryPlan::Divide(512 * kMiB - 1),
              FailsWith(absl::StatusCode::kResourceExhausted, "give 512 or more"));
}

TEST(MemoryPlanTest, ReadsAmountsAndShares) {
  constexpr int64_t kMachine = 1000 * kMiB;
  const std::pair<const char*, int64_t> good[] = {
      {"50%", kMachine / 2},       {"100%", kMachine},     {"16GB", 16'000'000'000},
      {"1.5GiB", 1536 * kMiB},     {"512MiB", 512 * kMiB}, {"1073741824", 1024 * kMiB},
      {"1073741824B", 1024 * kMiB}};
  for (const auto& [text, bytes] : good) {
    ASSERT_OK_AND_ASSIGN(const int64_t read, ParseMemoryLimit(text, kMachine));
    EXPECT_EQ(read, bytes) << text;
  }
  for (const char* bad : {"", "%", "101%", "-5GB", "0", "16 GB", "16gb", "nan", "inf%", "1e30GB",
                          "1e400", "GB", "5%%"}) {
    EXPECT_THAT(ParseMemoryLimit(bad, kMachine),
                FailsWith(absl::StatusCode::kInvalidArgument, "--memory-limit"))
        << bad;
  }
  EXPECT_GT(MachineBytes(), 64 * kMiB);
}

}  // namespace
}  // namespace fovea::server
