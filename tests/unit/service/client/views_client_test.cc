#include "service/client/views_client.h"

#include <thread>
#include <vector>

#include <gmock/gmock.h>

#include "tests/unit/service/server/server_test_util.h"

namespace fovea::client {
namespace {

using ::fovea::testing::FailsWith;

class ViewsClientTest : public server::ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    StartServer();
    ASSERT_OK_AND_ASSIGN(client_, ViewsClient::Connect(server_->address()));
    ASSERT_OK_AND_ASSIGN(whole_, Client::Connect(server_->address()));
  }

  static frames::FrameSpec Spec(double azimuth_deg = 30) {
    frames::FrameSpec spec = *wire::FromProto(SmallSpec(), "spec");
    spec.view.azimuth_deg = azimuth_deg;
    spec.rate = 30;
    return spec;
  }
  static View At(double azimuth_deg, uint64_t id, bool moving = false) {
    View view;
    view.dataset = "plume";
    view.step = 2;
    view.spec = Spec(azimuth_deg);
    view.id = id;
    view.moving = moving;
    view.frame_budget_ms = 1;  // less than any frame takes: the lowest rate comes first
    return view;
  }
  std::string Whole(const frames::FrameSpec& spec) {
    const auto frame = whole_->RenderFrame("plume", 2, spec);
    EXPECT_OK(frame.status());
    return frame.ok() ? frame->pixels : "";
  }

  std::unique_ptr<ViewsClient> client_;
  std::unique_ptr<Client> whole_;
};

TEST_F(ViewsClientTest, RefineSharpensToTheFrameThatRenderFrameGives) {
  RefineRequest request{.dataset = "plume", .step = 2, .spec = Spec(), .first_frame_ms = 1};
  std::vector<ViewFrame> got;
  ASSERT_OK(client_->Refine(request, [&](const ViewFrame& frame) {
    got.push_back(frame);
    return true;
  }));
  ASSERT_GE(got.size(), 2U);
  for (size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].final, i + 1 == got.size());
    EXPECT_EQ(got[i].frame.index, i);
    EXPECT_TRUE(i == 0 || got[i].frame.used.rate->x > got[i - 1].frame.used.rate->x);
  }
  EXPECT_TRUE(got.back().frame.pixels == Whole(Spec()));
  int taken = 0;
  EXPECT_OK(client_->Refine(request, [&](const ViewFrame&) { return ++taken < 1; }));
  EXPECT_EQ(taken, 1);
}

TEST_F(ViewsClientTest, TheLastViewIsDrawnInFullWhateverTheWindow) {
  for (const uint32_t window : {0U, 1U, 2U}) {
    std::vector<ViewFrame> got;
    const auto exploration = client_->Explore(
        [&](const ViewFrame& frame) {
          got.push_back(frame);
          return true;
        },
        window);
    for (uint64_t id = 10; id <= 14; ++id) {
      ASSERT_OK(exploration->Show(At(10.0 * static_cast<double>(id), id, id < 13)));
    }
    ASSERT_OK(exploration->Finish());
    EXPECT_OK(exploration->Finish());
    ASSERT_FALSE(got.empty());
    for (size_t i = 1; i < got.size(); ++i) {
      EXPECT_GE(got[i].view_id, got[i - 1].view_id);
      EXPECT_EQ(got[i].frame.index, i);
    }
    EXPECT_EQ(got.back().view_id, 14U);
    EXPECT_TRUE(got.back().final);
    EXPECT_TRUE(got.back().frame.pixels == Whole(Spec(140))) << window;
  }
}

TEST_F(ViewsClientTest, AViewThatMovedLastComesToRest) {
  ViewFrame last;
  const auto exploration = client_->Explore([&](const ViewFrame& frame) {
    last = frame;
    return true;
  });
  ASSERT_OK(exploration->Show(At(75, 7, true)));
  ASSERT_OK(exploration->Finish());
  EXPECT_TRUE(last.final);
  EXPECT_EQ(last.view_id, 7U);
  EXPECT_TRUE(last.frame.pixels == Whole(Spec(75)));
}

TEST_F(ViewsClientTest, AViewIsWholeWhateverCameBefore) {
  ViewFrame last;
  const auto exploration = client_->Explore([&](const ViewFrame& frame) {
    last = frame;
    return true;
  });
  View first = At(30, 1);
  first.spec.lighting.emplace().enabled = true;
  ASSERT_OK(exploration->Show(first));
  ASSERT_OK(exploration->Show(At(30, 2)));
  ASSERT_OK(exploration->Finish());
  EXPECT_FALSE(last.frame.used.lighting.has_value());
  EXPECT_TRUE(last.frame.pixels == Whole(Spec(30)));
}

TEST_F(ViewsClientTest, ViewsMayComeFromManyThreads) {
  uint64_t last = 0;
  const auto exploration = client_->Explore([&](const ViewFrame& frame) {
    last = frame.final ? frame.view_id : last;
    return true;
  });
  std::vector<std::thread> threads;
  for (uint64_t id = 1; id <= 4; ++id) {
    threads.emplace_back([&, id] {
      for (int i = 0; i < 10; ++i) {
        EXPECT_OK(exploration->Show(At(i, id, true)));
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_OK(exploration->Finish());
  EXPECT_TRUE(last >= 1 && last <= 4) << last;
}

TEST_F(ViewsClientTest, ItCanBeStoppedAndLeft) {
  int taken = 0;
  const auto stopped = client_->Explore([&](const ViewFrame&) {
    ++taken;
    return false;
  });
  ASSERT_OK(stopped->Show(At(30, 1)));
  EXPECT_OK(stopped->Finish());
  EXPECT_EQ(taken, 1);
  EXPECT_OK(client_->Explore([](const ViewFrame&) { return true; })->Finish());  // nothing asked
  const auto left = client_->Explore([](const ViewFrame&) { return true; });
  EXPECT_OK(left->Show(At(30, 1)));  // and goes while it is drawn
}

TEST_F(ViewsClientTest, ErrorsAreTheServersAndSayWhich) {
  const auto exploration = client_->Explore([](const ViewFrame&) { return true; });
  View view = At(30, 1);
  view.step = -1;
  EXPECT_THAT(exploration->Show(view), FailsWith(absl::StatusCode::kInvalidArgument, "step -1"));
  view = At(30, 1);
  view.dataset = "nothing";
  EXPECT_OK(exploration->Show(view));
  const Status status = exploration->Finish();
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kNotFound, "no dataset 'nothing'"));
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kNotFound, server_->address()));
  EXPECT_EQ(exploration->Show(At(30, 2)), status);
  RefineRequest request{.dataset = "plume", .step = 99, .spec = Spec()};
  EXPECT_THAT(client_->Refine(request, [](const ViewFrame&) { return true; }),
              FailsWith(absl::StatusCode::kOutOfRange, "0 to 4"));
  request.first_frame_ms = 0;
  EXPECT_EQ(wire::FieldOf(client_->Refine(request, [](const ViewFrame&) { return true; })),
            "first_frame_ms");
}

}  // namespace
}  // namespace fovea::client
