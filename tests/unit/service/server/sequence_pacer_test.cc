#include "service/server/sequence_pacer.h"

#include <algorithm>
#include <optional>
#include <random>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using Actions = SequencePacer::Actions;

bool Nothing(const Actions& actions) {
  return !actions.render && !actions.write && !actions.finish;
}

TEST(SequencePacerTest, RendersOneAheadOfTheWriteWithoutAWindow) {
  SequencePacer pacer(0);
  Actions actions = pacer.OnOpened(0, 3);
  EXPECT_EQ(actions.render, 0);
  actions = pacer.OnRendered(absl::OkStatus());
  EXPECT_TRUE(actions.write);
  EXPECT_EQ(actions.render, 1);
  actions = pacer.OnRendered(absl::OkStatus());  // frame 1 waits for the write of frame 0
  EXPECT_TRUE(Nothing(actions));
  actions = pacer.OnWriteDone(true);
  EXPECT_TRUE(actions.write);
  EXPECT_EQ(actions.render, 2);
  EXPECT_TRUE(Nothing(pacer.OnWriteDone(true)));
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  actions = pacer.OnWriteDone(true);
  ASSERT_TRUE(actions.finish.has_value());
  EXPECT_OK(*actions.finish);
}

TEST(SequencePacerTest, TheWindowHoldsRenderingBack) {
  SequencePacer pacer(2);
  EXPECT_EQ(pacer.OnOpened(5, 9).render, 5);
  EXPECT_EQ(pacer.OnRendered(absl::OkStatus()).render, 6);
  EXPECT_TRUE(Nothing(pacer.OnRendered(absl::OkStatus())));
  EXPECT_FALSE(pacer.OnWriteDone(true).render.has_value());
  ASSERT_OK_AND_ASSIGN(Actions actions, pacer.OnAcknowledged(5));
  EXPECT_EQ(actions.render, 7);
  ASSERT_OK_AND_ASSIGN(actions, pacer.OnAcknowledged(5));  // again: nothing
  EXPECT_TRUE(Nothing(actions));
  EXPECT_THAT(pacer.OnAcknowledged(7), FailsWith(absl::StatusCode::kInvalidArgument, "index"));
}

TEST(SequencePacerTest, FollowingSkipsToTheNewestOfWhatCameLater) {
  SequencePacer pacer(1);
  EXPECT_EQ(pacer.OnOpenedToFollow(3, 5).render, 3);
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  EXPECT_TRUE(Nothing(pacer.OnWriteDone(true)));
  EXPECT_TRUE(Nothing(pacer.OnGrown(9)));
  ASSERT_OK_AND_ASSIGN(Actions actions, pacer.OnAcknowledged(3));
  EXPECT_EQ(actions.render, 4);  // there when it was opened: not skipped
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  EXPECT_TRUE(Nothing(pacer.OnWriteDone(true)));
  ASSERT_OK_AND_ASSIGN(actions, pacer.OnAcknowledged(4));
  EXPECT_EQ(actions.render, 8);
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  EXPECT_THAT(pacer.OnAcknowledged(9), FailsWith(absl::StatusCode::kInvalidArgument, "index"));
  ASSERT_OK_AND_ASSIGN(actions, pacer.OnAcknowledged(8));
  EXPECT_TRUE(Nothing(actions));  // nothing newer, and no end
  EXPECT_TRUE(Nothing(pacer.OnWriteDone(true)));
  EXPECT_EQ(pacer.OnGrown(10).render, 9);
}

TEST(SequencePacerTest, FollowingEndsWhenItsDatasetGoes) {
  SequencePacer pacer(0);
  EXPECT_EQ(pacer.OnOpenedToFollow(0, 1).render, 0);
  EXPECT_TRUE(Nothing(pacer.OnBroken(NotFound("gone"))));
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);  // what was under way is still sent
  const Actions actions = pacer.OnWriteDone(true);
  ASSERT_TRUE(actions.finish.has_value());
  EXPECT_THAT(*actions.finish, FailsWith(absl::StatusCode::kNotFound, "gone"));
}

TEST(SequencePacerTest, NothingToSendIsASuccess) {
  SequencePacer pacer(0);
  const Actions actions = pacer.OnOpened(4, 4);
  ASSERT_TRUE(actions.finish.has_value());
  EXPECT_OK(*actions.finish);
}

TEST(SequencePacerTest, AnErrorComesAfterTheFramesBeforeIt) {
  SequencePacer pacer(0);
  EXPECT_EQ(pacer.OnOpened(0, 3).render, 0);
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  EXPECT_TRUE(Nothing(pacer.OnRendered(DataLoss("chunk"))));  // frame 0 is still being written
  const Actions actions = pacer.OnWriteDone(true);
  ASSERT_TRUE(actions.finish.has_value());
  EXPECT_THAT(*actions.finish, FailsWith(absl::StatusCode::kDataLoss, "chunk"));
}

TEST(SequencePacerTest, ACancelWhileOpeningEndsIt) {
  SequencePacer pacer(2);
  const Actions actions = pacer.OnCancelled();
  ASSERT_TRUE(actions.finish.has_value());
  EXPECT_EQ(actions.finish->code(), absl::StatusCode::kCancelled);
  EXPECT_TRUE(Nothing(pacer.OnOpened(0, 3)));
}

TEST(SequencePacerTest, ACancelEndsAStreamThatWaitsForAnAcknowledgement) {
  SequencePacer pacer(1);
  EXPECT_EQ(pacer.OnOpened(0, 3).render, 0);
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  EXPECT_TRUE(Nothing(pacer.OnWriteDone(true)));
  EXPECT_TRUE(pacer.OnCancelled().finish.has_value());
  EXPECT_TRUE(pacer.over());
}

TEST(SequencePacerTest, ACancelWaitsForTheWriteAndNotForTheRender) {
  SequencePacer pacer(0);
  EXPECT_EQ(pacer.OnOpened(0, 3).render, 0);
  EXPECT_EQ(pacer.OnRendered(absl::OkStatus()).render, 1);
  EXPECT_TRUE(Nothing(pacer.OnCancelled()));
  EXPECT_TRUE(pacer.OnWriteDone(false).finish.has_value());
  EXPECT_TRUE(Nothing(pacer.OnRendered(absl::OkStatus())));  // too late, thrown away
}

TEST(SequencePacerTest, AFailedWriteEndsIt) {
  SequencePacer pacer(0);
  EXPECT_EQ(pacer.OnOpened(0, 3).render, 0);
  EXPECT_TRUE(pacer.OnRendered(absl::OkStatus()).write);
  const Actions actions = pacer.OnWriteDone(false);
  ASSERT_TRUE(actions.finish.has_value());
  EXPECT_EQ(actions.finish->code(), absl::StatusCode::kCancelled);
}

/// A stream, its renderer and its client, taking turns at random.
class RandomStream {
 public:
  RandomStream(unsigned seed, uint32_t window, int64_t frames)
      : random_(seed), window_(window), frames_(frames), pacer_(window) {}

  void Run() {
    Apply(pacer_.OnOpened(0, frames_));
    for (int turn = 0; turn < 10'000 && !finished_; ++turn) {
      Turn();
    }
    ASSERT_TRUE(finished_);
    EXPECT_TRUE(cancelled_ || written_ == frames_);
  }

 private:
  void Turn() {
    switch (random_() % 20) {
      case 0:
        if (random_() % 40 == 0) {
          cancelled_ = true;
          Apply(pacer_.OnCancelled());
        }
        break;
      case 1:
      case 2:
      case 3:
      case 4:
      case 5:
      case 6:
      case 7:
        if (rendering_) {
          rendering_ = false;
          ++ready_;
          Apply(pacer_.OnRendered(absl::OkStatus()));
        }
        break;
      case 8:
      case 9:
      case 10:
      case 11:
      case 12:
      case 13:
        if (writing_) {
          writing_ = false;
          ++written_;
          Apply(pacer_.OnWriteDone(!cancelled_));
        }
        break;
      default:
        if (shown_ < written_) {
          ++shown_;
          const auto actions = pacer_.OnAcknowledged(static_cast<uint64_t>(shown_ - 1));
          ASSERT_TRUE(actions.ok());
          Apply(*actions);
        }
    }
  }

  void Apply(const Actions& actions) {
    ASSERT_FALSE(finished_ && !Nothing(actions));
    if (actions.write) {
      ASSERT_FALSE(writing_);
      ASSERT_EQ(ready_, 1);
      ready_ = 0;
      writing_ = true;
    }
    if (actions.render) {
      ASSERT_FALSE(rendering_ || cancelled_);
      ASSERT_EQ(*actions.render, asked_);
      rendering_ = true;
      ++asked_;
    }
    if (actions.finish) {
      ASSERT_FALSE(writing_);
      finished_ = true;
    }
    ASSERT_LE(ready_, 1);
    ASSERT_TRUE(window_ == 0 || asked_ - shown_ <= static_cast<int64_t>(window_));
  }

  std::mt19937 random_;
  const uint32_t window_;
  const int64_t frames_;
  SequencePacer pacer_;
  bool rendering_ = false, writing_ = false, cancelled_ = false, finished_ = false;
  int ready_ = 0;
  int64_t asked_ = 0, written_ = 0, shown_ = 0;
};

TEST(SequencePacerTest, KeepsItsRulesWhateverHappens) {
  for (unsigned seed = 0; seed < 500; ++seed) {
    SCOPED_TRACE(seed);
    RandomStream(seed, seed % 5, 1 + seed % 23).Run();
    if (HasFatalFailure()) {
      return;
    }
  }
}

}  // namespace
}  // namespace fovea::server
