#include "service/server/view_pacer.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

/// The pacer with what its owner would remember.
struct Owner {
  ViewPacer pacer;
  bool open = false, render = false, write = false;
  int opens = 0, renders = 0, writes = 0, finishes = 0;
  Status end;
  bool kept = false;

  void Take(ViewPacer::Actions actions) {
    EXPECT_FALSE(finishes > 0 && (actions.open || actions.render || actions.write));
    EXPECT_FALSE(actions.open && open);
    EXPECT_FALSE(actions.render && render);
    EXPECT_FALSE(actions.write && write);
    open |= actions.open;
    render |= actions.render;
    write |= actions.write;
    opens += actions.open ? 1 : 0;
    renders += actions.render ? 1 : 0;
    writes += actions.write ? 1 : 0;
    if (actions.finish) {
      ++finishes;
      end = *actions.finish;
    }
  }
  void View() { Take(pacer.OnView()); }
  void Opened(bool moving = false) {
    pacer.BeginOpen();
    open = false;
    Take(pacer.OnOpened(absl::OkStatus(), moving));
  }
  void Rendered(bool is_last) {
    render = false;
    Take(pacer.OnRendered(absl::OkStatus(), is_last, &kept));
  }
  void Written() {
    write = false;
    Take(pacer.OnWriteDone(true));
  }
};

TEST(ViewPacerTest, AViewAtRestIsDrawnUpToTheLastFrame) {
  Owner owner;
  owner.View();
  owner.Take(owner.pacer.OnNoMoreViews());
  owner.Opened();
  for (const bool is_last : {false, false, true}) {
    ASSERT_TRUE(owner.render);
    owner.Rendered(is_last);
    EXPECT_TRUE(owner.kept);
    ASSERT_TRUE(owner.write);
    EXPECT_EQ(owner.finishes, 0);
    owner.Written();
  }
  EXPECT_FALSE(owner.render);
  EXPECT_EQ(owner.finishes, 1);
  EXPECT_OK(owner.end);
}

TEST(ViewPacerTest, OnlyTheNewestOfTheViewsThatWaitIsOpened) {
  Owner owner;
  owner.View();
  owner.Opened();
  owner.View();
  owner.View();
  owner.View();
  EXPECT_EQ(owner.opens, 2);
  owner.Opened();  // the fourth
  EXPECT_EQ(owner.opens, 2);
  EXPECT_EQ(owner.renders, 1);
  owner.Rendered(false);  // of the first view
  EXPECT_TRUE(owner.kept) << "the first picture that there is";
  EXPECT_TRUE(owner.render);
}

TEST(ViewPacerTest, ASharperFrameOfAnOldViewIsThrownAway) {
  Owner owner;
  owner.View();
  owner.Opened();
  owner.Rendered(false);
  owner.Written();
  ASSERT_TRUE(owner.render);  // the second frame of the first view
  owner.View();
  owner.Rendered(true);
  EXPECT_FALSE(owner.kept);
  EXPECT_EQ(owner.writes, 1);
}

TEST(ViewPacerTest, AMovingViewIsDrawnOnce) {
  Owner owner;
  owner.View();
  owner.Opened(/*moving=*/true);
  owner.Rendered(false);
  owner.Written();
  EXPECT_FALSE(owner.render);
  owner.View();
  owner.Opened(/*moving=*/false);
  EXPECT_TRUE(owner.render);
}

TEST(ViewPacerTest, AFrameThatWaitsGivesWayToANewerViewButHoldsUpItsOwn) {
  Owner owner;
  owner.View();
  owner.Opened();
  owner.Rendered(false);  // being written, and the client is slow
  owner.Rendered(false);  // waits
  EXPECT_FALSE(owner.render);
  owner.View();
  owner.Opened();
  EXPECT_TRUE(owner.render);
  owner.Rendered(false);
  EXPECT_EQ(owner.writes, 1);
  owner.Written();
  EXPECT_EQ(owner.writes, 2);
}

TEST(ViewPacerTest, AWindowHoldsFramesBackUntilTheyAreAcknowledged) {
  Owner owner;
  owner.pacer.SetWindow(1);
  owner.View();
  owner.Opened();
  owner.Rendered(false);
  owner.Written();
  owner.Rendered(true);
  EXPECT_FALSE(owner.write);
  EXPECT_THAT(owner.pacer.OnAcknowledged(1).status(),
              FailsWith(absl::StatusCode::kInvalidArgument, "acknowledged"));
  owner.Take(*owner.pacer.OnAcknowledged(0));
  EXPECT_TRUE(owner.write);
}

TEST(ViewPacerTest, AnErrorOrACancelWaitsForTheWriteInFlight) {
  for (const bool cancel : {false, true}) {
    Owner owner;
    owner.View();
    owner.Opened();
    owner.Rendered(false);
    owner.Take(cancel ? owner.pacer.OnCancelled()
                      : owner.pacer.OnError(InvalidArgument("spec.rate: no")));
    EXPECT_EQ(owner.finishes, 0);
    owner.Written();
    EXPECT_EQ(owner.finishes, 1);
    EXPECT_EQ(owner.end.code(),
              cancel ? absl::StatusCode::kCancelled : absl::StatusCode::kInvalidArgument);
    owner.Rendered(true);  // comes late
    EXPECT_EQ(owner.writes, 1);
  }
}

TEST(ViewPacerTest, NothingToShowIsNoError) {
  Owner owner;
  owner.Take(owner.pacer.OnNoMoreViews());
  EXPECT_EQ(owner.finishes, 1);
  EXPECT_OK(owner.end);
}

/// Whatever comes in whatever order: one end, and the newest view is drawn to the last frame.
TEST(ViewPacerTest, RandomWalksEndOnceWithTheNewestViewDrawn) {
  std::mt19937 random(7);
  for (int walk = 0; walk < 2000; ++walk) {
    Owner owner;
    int views = 0;
    bool newest_is_drawn = false;
    int frames_of_view = 0;
    int opened_view = 0;
    int rendering_view = 0;
    for (int step = 0; step < 400 && owner.finishes == 0; ++step) {
      switch (random() % 6) {
        case 0:
          if (views < 20) {
            ++views;
            owner.View();
          } else {
            owner.Take(owner.pacer.OnNoMoreViews());
          }
          break;
        case 1:
          if (owner.open) {
            opened_view = views;
            frames_of_view = 0;
            owner.Opened();
          }
          break;
        case 2:
        case 3:
          if (owner.render) {
            owner.pacer.BeginRender();
            rendering_view = opened_view;
            const bool is_last = ++frames_of_view == 3;
            owner.Rendered(is_last);
            newest_is_drawn = rendering_view == views && is_last && owner.kept;
          }
          break;
        default:
          if (owner.write) {
            owner.Written();
          }
      }
    }
    ASSERT_EQ(owner.finishes, 1) << walk;
    EXPECT_OK(owner.end);
    EXPECT_TRUE(newest_is_drawn) << walk;
  }
}

}  // namespace
}  // namespace fovea::server
