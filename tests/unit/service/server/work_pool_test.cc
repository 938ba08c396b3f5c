#include "service/server/work_pool.h"

#include <atomic>
#include <future>
#include <latch>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sched.h>

#include "service/server/call_tracker.h"
#include "service/server/give_way.h"
#include "service/server/memory_budget.h"
#include "service/wire/status.h"
#include "tests/support/status_matchers.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using std::chrono::milliseconds;

WorkPool::Limits Limits(int threads, int max_waiting, int64_t max_running_bytes = INT64_MAX) {
  return {.name = "test queue",
          .flag = "--queue 1",
          .threads = threads,
          .max_waiting = max_waiting,
          .max_running_bytes = max_running_bytes};
}

/// A job that tells when it started and then waits to be let go.
class Gate {
 public:
  WorkPool::Job Job() {
    return [this](int) {
      started_.set_value();
      open_.get_future().wait();
    };
  }
  void AwaitStart() { started_.get_future().wait(); }
  void Open() { open_.set_value(); }

 private:
  std::promise<void> started_, open_;
};

TEST(WorkPoolTest, RunsEveryJobOnce) {
  std::atomic<int> runs = 0;
  std::latch done(200);
  WorkPool pool(Limits(3, 1000));
  for (int i = 0; i < 200; ++i) {
    ASSERT_OK(pool.Submit(0,
                          [&](int) {
                            ++runs;
                            done.count_down();
                          })
                  .status());
  }
  done.wait();
  EXPECT_EQ(runs, 200);
}

TEST(WorkPoolTest, AFullQueueRefusesAndNamesTheLimit) {
  Gate gate;
  WorkPool pool(Limits(1, 1));
  ASSERT_OK(pool.Submit(0, gate.Job()).status());
  gate.AwaitStart();
  ASSERT_OK(pool.Submit(0, [](int) {}).status());
  EXPECT_THAT(pool.Submit(0, [](int) {}),
              FailsWith(absl::StatusCode::kResourceExhausted,
                        "test queue is full: 1 calls wait already (--queue 1)"));
  std::promise<void> admitted;
  pool.SubmitAdmitted(0, [&](int) { admitted.set_value(); });
  gate.Open();
  admitted.get_future().wait();
}

TEST(WorkPoolTest, WhatIsRemovedNeverRunsAndFreesItsPlace) {
  Gate gate;
  std::atomic<bool> ran = false;
  {
    WorkPool pool(Limits(1, 1));
    ASSERT_OK_AND_ASSIGN(const auto running, pool.Submit(0, gate.Job()));
    gate.AwaitStart();
    ASSERT_OK_AND_ASSIGN(const auto waiting, pool.Submit(0, [&](int) { ran = true; }));
    EXPECT_TRUE(pool.Remove(waiting));
    EXPECT_FALSE(pool.Remove(waiting));
    EXPECT_FALSE(pool.Remove(running));
    std::promise<void> next;
    ASSERT_OK(pool.Submit(0, [&](int) { next.set_value(); }).status());
    gate.Open();
    next.get_future().wait();
  }
  EXPECT_FALSE(ran);
}

TEST(WorkPoolTest, JobsThatNeedTooMuchMemoryTogetherRunOneAfterTheOther) {
  std::promise<void> small_started;
  std::promise<void> large_started;
  auto small = small_started.get_future();
  auto large = large_started.get_future();
  std::promise<bool> overlapped;
  WorkPool pool(Limits(4, 100, 10));
  ASSERT_OK(pool.Submit(6,
                        [&](int) {
                          small.wait();  // 6 + 4 fit
                          overlapped.set_value(large.wait_for(milliseconds(50)) ==
                                               std::future_status::ready);
                        })
                .status());
  ASSERT_OK(pool.Submit(4, [&](int) { small_started.set_value(); }).status());
  pool.SubmitAdmitted(50, [&](int) { large_started.set_value(); });  // alone
  EXPECT_FALSE(overlapped.get_future().get());
}

TEST(WorkPoolTest, WhatCanNeverRunIsRefused) {
  WorkPool pool(Limits(1, 10, 10));
  const Status status = pool.Submit(11, [](int) {}).status();
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kResourceExhausted, "--memory-limit"));
  EXPECT_FALSE(wire::RetryDelayOf(status).has_value());
}

TEST(WorkPoolTest, ClientsTakeTurns) {
  Gate gate;
  std::string order;  // one thread writes it
  std::latch done(8);
  WorkPool pool(Limits(1, 100));
  ASSERT_OK(pool.Submit(0, gate.Job()).status());
  gate.AwaitStart();
  const auto submit = [&](const std::string& client, int jobs) {
    for (int i = 0; i < jobs; ++i) {
      ASSERT_OK(pool.Submit(
                        0,
                        [&, client](int) {
                          order += client;
                          done.count_down();
                        },
                        client)
                    .status());
    }
  };
  submit("a", 5);
  submit("b", 2);
  submit("c", 1);
  gate.Open();
  done.wait();
  EXPECT_EQ(order, "abcabaaa");
}

TEST(WorkPoolTest, OneClientLeavesRoomForOthers) {
  Gate gate;
  WorkPool pool(Limits(1, 8));
  ASSERT_OK(pool.Submit(0, gate.Job()).status());
  gate.AwaitStart();
  const auto fill = [&](const std::string& client) {
    int admitted = 0;
    while (pool.Submit(
                   0, [](int) {}, client)
               .ok()) {
      ++admitted;
    }
    return admitted;
  };
  EXPECT_EQ(fill("greedy"), 4);
  const Status refused = pool.Submit(
                                 0, [](int) {}, "greedy")
                             .status();
  EXPECT_THAT(refused, FailsWith(absl::StatusCode::kResourceExhausted, "its share"));
  EXPECT_TRUE(wire::RetryDelayOf(refused).has_value());
  EXPECT_EQ(pool.CheckRoom("greedy"), refused);
  EXPECT_OK(pool.CheckRoom("second"));
  EXPECT_EQ(fill("second"), 2);
  EXPECT_EQ(fill("third"), 1);
  EXPECT_EQ(pool.counts().waiting, 7);
  EXPECT_EQ(pool.counts().refused, 5U);
  gate.Open();
}

TEST(WorkPoolTest, AJobAloneGetsAllThreads) {
  std::promise<int> alone;
  std::promise<int> second;
  Gate gate;
  WorkPool pool(Limits(4, 10));
  ASSERT_OK(pool.Submit(0, [&](int threads) { alone.set_value(threads); }).status());
  EXPECT_EQ(alone.get_future().get(), 4);
  ASSERT_OK(pool.Submit(0, gate.Job()).status());
  gate.AwaitStart();
  ASSERT_OK(pool.Submit(0, [&](int threads) { second.set_value(threads); }).status());
  EXPECT_LE(second.get_future().get(), 2);
  gate.Open();
}

TEST(WorkPoolTest, WhatWaitsHasItsShareOfTheThreads) {
  std::promise<int> shares[3];
  std::latch all(3);
  WorkPool pool(Limits(4, 10));
  {
    std::vector<Gate> gates(4);
    for (Gate& gate : gates) {
      ASSERT_OK(pool.Submit(0, gate.Job()).status());
      gate.AwaitStart();
    }
    for (auto& share : shares) {
      ASSERT_OK(pool.Submit(0,
                            [&](int threads) {
                              share.set_value(threads);
                              all.arrive_and_wait();
                            })
                    .status());
    }
    gates[0].Open();  // one thread is free, three jobs wait
    EXPECT_EQ(shares[0].get_future().get(), 1);
    for (int i = 1; i < 4; ++i) {
      gates[static_cast<size_t>(i)].Open();
    }
    all.wait();
  }
}

TEST(WorkPoolTest, IsCrowdedAfterARefusal) {
  Gate gate;
  WorkPool pool(Limits(1, 2));
  ASSERT_OK(pool.Submit(0, gate.Job()).status());
  gate.AwaitStart();
  EXPECT_FALSE(pool.IsCrowded());
  ASSERT_OK(pool.Submit(0, [](int) {}).status());
  EXPECT_FALSE(pool.IsCrowded());
  EXPECT_FALSE(pool.CheckRoom("").ok());
  EXPECT_TRUE(pool.IsCrowded());
  gate.Open();
}

TEST(GiveWayTest, AThreadOfTheNetworkPreemptsNobodyWhileItIsCrowded) {
  EXPECT_EQ(::sched_getscheduler(0), SCHED_OTHER);
  GiveWay(true);
  EXPECT_EQ(::sched_getscheduler(0), SCHED_BATCH);
  GiveWay(false);
  EXPECT_EQ(::sched_getscheduler(0), SCHED_OTHER);
}

TEST(WorkPoolTest, TheEndDropsWhatWaits) {
  Gate gate;
  std::atomic<bool> ran = false;
  const auto held = std::make_shared<int>(0);
  std::future<void> opener;
  {
    WorkPool pool(Limits(1, 10));
    ASSERT_OK(pool.Submit(0, gate.Job()).status());
    gate.AwaitStart();
    ASSERT_OK(pool.Submit(0, [&ran, held](int) { ran = true; }).status());
    // The dropped job goes before the running one is waited for.
    opener = std::async(std::launch::async, [&] {
      while (held.use_count() > 1) {
        std::this_thread::yield();
      }
      gate.Open();
    });
  }
  EXPECT_FALSE(ran);
}

TEST(MemoryBudgetTest, GivesBackWhatWasReserved) {
  MemoryBudget budget(int64_t{100} << 20);
  {
    ASSERT_OK_AND_ASSIGN(auto first, budget.Reserve(int64_t{60} << 20));
    EXPECT_THAT(budget.Reserve(int64_t{60} << 20),
                FailsWith(absl::StatusCode::kResourceExhausted, "for that is 100 MiB"));
    MemoryBudget::Reservation moved = std::move(first);
    EXPECT_FALSE(budget.Reserve(int64_t{60} << 20).ok());
  }
  EXPECT_OK(budget.Reserve(int64_t{100} << 20).status());
}

TEST(CallTrackerTest, DrainsToNothing) {
  CallTracker calls;
  auto slot = calls.Enter();
  ASSERT_TRUE(slot.has_value());
  CallTracker::Slot kept = *std::move(slot);
  calls.StopAdmitting();
  EXPECT_FALSE(calls.Enter().has_value());
  EXPECT_EQ(calls.WaitIdle(milliseconds(1)), 1);
  auto idle = std::async(std::launch::async, [&] { return calls.WaitIdle(milliseconds(60'000)); });
  kept = CallTracker::Slot();
  EXPECT_EQ(idle.get(), 0);
}

}  // namespace
}  // namespace fovea::server
