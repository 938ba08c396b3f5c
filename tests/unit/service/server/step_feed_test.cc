#include "service/server/step_feed.h"

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "service/server/watch_stream.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::server {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using std::chrono::milliseconds;

/// Long enough that nothing is noticed by itself while a test runs.
constexpr milliseconds kNever{3'600'000};
constexpr std::chrono::seconds kPatience{20};

class FeedTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(folder_.Path("root"));
    ASSERT_OK(store::testing::MakeStore(Path("plume"), Info(), 2));
    ASSERT_OK_AND_ASSIGN(catalogue_, Catalogue::Open(folder_.Path("root"), milliseconds(0)));
  }
  static store::DatasetInfo Info() { return store::testing::MakeInfo({12, 10, 9}, 8); }
  [[nodiscard]] std::string Path(const std::string& name) const {
    return folder_.Path("root/" + name + ".zarr");
  }
  void AppendStep(const std::string& name) const {
    auto writer = store::DatasetWriter::Append(Path(name));
    ASSERT_OK(writer.status());
    ASSERT_OK(store::testing::WriteSteps(writer->get(), 1));
  }

  store::testing::TemporaryFolder folder_;
  std::unique_ptr<Catalogue> catalogue_;
};

/// Keeps all that it is told, and lets a test wait for it.
class Listener final : public StepListener {
 public:
  void OnNews(const DatasetNews& news) override {
    const std::lock_guard lock(mutex_);
    news_.push_back(news);
    told_.notify_all();
  }
  /// The piece of news of this number; waits for it.
  DatasetNews Get(size_t index) {
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(told_.wait_for(lock, kPatience, [&] { return news_.size() > index; }));
    return news_.size() > index ? news_[index] : DatasetNews();
  }
  size_t count() {
    const std::lock_guard lock(mutex_);
    return news_.size();
  }

 private:
  std::mutex mutex_;
  std::condition_variable told_;
  std::vector<DatasetNews> news_;
};

TEST_F(FeedTest, TellsHowThingsStandAndThenOfEachCommit) {
  StepFeed feed(*catalogue_, milliseconds(1), milliseconds(1));
  const auto listener = std::make_shared<Listener>();
  feed.Subscribe("plume", listener);
  EXPECT_EQ(listener->Get(0).committed_steps, 2);
  AppendStep("plume");
  const DatasetNews news = listener->Get(1);
  EXPECT_EQ(news.committed_steps, 3);
  EXPECT_EQ(news.dataset->dataset().info().committed_steps, 3);
  EXPECT_EQ(news.dataset, listener->Get(0).dataset);
}

TEST_F(FeedTest, OneLookServesAllWhoListen) {
  StepFeed feed(*catalogue_, kNever, kNever);
  std::vector<std::shared_ptr<Listener>> listeners;
  for (int i = 0; i < 100; ++i) {
    listeners.push_back(std::make_shared<Listener>());
    feed.Subscribe("plume", listeners.back());
  }
  for (const auto& listener : listeners) {
    EXPECT_EQ(listener->Get(0).committed_steps, 2);
  }
  const int64_t looks = feed.looks();
  AppendStep("plume");
  feed.Poke("plume");
  for (const auto& listener : listeners) {
    EXPECT_EQ(listener->Get(1).committed_steps, 3);
  }
  EXPECT_LE(looks, 20);  // who subscribes while it looks is served by the next
  EXPECT_EQ(feed.looks(), looks + 1);
  feed.Poke("nobody listens to this");
}

TEST_F(FeedTest, GoneReplacedAndThereAgain) {
  StepFeed feed(*catalogue_, milliseconds(1), milliseconds(1));
  const auto listener = std::make_shared<Listener>();
  feed.Subscribe("plume", listener);
  const auto first = listener->Get(0).dataset;
  fs::rename(Path("plume"), folder_.Path("gone.zarr"));
  EXPECT_EQ(listener->Get(1).dataset, nullptr);
  EXPECT_THAT(listener->Get(1).error, FailsWith(absl::StatusCode::kNotFound, "plume"));
  ASSERT_OK(store::testing::MakeStore(folder_.Path("new.zarr"), Info(), 1));
  fs::rename(folder_.Path("new.zarr"), Path("plume"));
  const DatasetNews back = listener->Get(2);
  EXPECT_NE(back.dataset, first);
  EXPECT_EQ(back.committed_steps, 1);
  ASSERT_OK(store::testing::MakeStore(folder_.Path("other.zarr"), Info(), 4));
  fs::rename(Path("plume"), folder_.Path("old.zarr"));
  fs::rename(folder_.Path("other.zarr"), Path("plume"));
  size_t at = 3;  // between the two it may be seen to be gone
  DatasetNews other = listener->Get(at);
  if (other.dataset == nullptr) {
    other = listener->Get(++at);
  }
  EXPECT_NE(other.dataset, back.dataset);
  EXPECT_EQ(other.committed_steps, 4);
}

TEST_F(FeedTest, ListenersThatWentAreForgotten) {
  StepFeed feed(*catalogue_, kNever, kNever);
  auto listener = std::make_shared<Listener>();
  feed.Subscribe("plume", listener);
  listener->Get(0);
  listener.reset();
  AppendStep("plume");
  feed.Poke("plume");
  const auto other = std::make_shared<Listener>();
  feed.Subscribe("other", other);
  EXPECT_EQ(other->Get(0).dataset, nullptr);
  EXPECT_EQ(feed.looks(), 2);  // of plume once, of other once
}

TEST_F(FeedTest, ClosingTellsThoseOfNowAndLater) {
  StepFeed feed(*catalogue_, kNever, kNever);
  const auto before = std::make_shared<Listener>();
  feed.Subscribe("plume", before);
  before->Get(0);
  feed.Close();
  EXPECT_TRUE(before->Get(1).closing);
  const auto after = std::make_shared<Listener>();
  feed.Subscribe("plume", after);
  EXPECT_TRUE(after->Get(0).closing);
}

/// The client of a watch, which reads when the test says so.
class FakeViewer final : public EventSink {
 public:
  explicit FakeViewer(Services& services)
      : stream_(std::make_shared<WatchStream>(services, *this)),
        caller_(*services.gate->Identify({})) {}

  void Start(const wire::WatchRequest& request) { stream_->Start(request, caller_); }
  void Cancel() { stream_->OnCancel(); }
  void Write(const v1::DatasetEvent& event) override {
    const std::lock_guard lock(mutex_);
    EXPECT_FALSE(event_.has_value()) << "two writes at a time";
    event_ = event;
    changed_.notify_all();
  }
  void Finish(const Status& status) override {
    const std::lock_guard lock(mutex_);
    EXPECT_FALSE(end_.has_value()) << "finished twice";
    end_ = status;
    changed_.notify_all();
  }
  /// The message that is being sent, without reading it.
  void WaitForEvent() {
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(changed_.wait_for(lock, kPatience, [this] { return event_.has_value(); }));
  }
  v1::DatasetEvent Read() {
    v1::DatasetEvent event;
    WaitForEvent();
    {
      const std::lock_guard lock(mutex_);
      event.Swap(&*event_);
      event_.reset();
    }
    stream_->OnWriteDone(true);
    return event;
  }
  Status WaitForEnd() {
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(changed_.wait_for(lock, kPatience, [this] { return end_.has_value(); }));
    return end_.value_or(Internal("it did not end"));
  }
  void LoseClient() { stream_->OnWriteDone(false); }

 private:
  const std::shared_ptr<WatchStream> stream_;
  const std::shared_ptr<access::Caller> caller_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<v1::DatasetEvent> event_;
  std::optional<Status> end_;
};

class WatchStreamTest : public FeedTest {
 protected:
  void SetUp() override {
    FeedTest::SetUp();
    services_ = std::make_unique<Services>(
        std::move(catalogue_), *access::Gate::Open(""), int64_t{1} << 30,
        WorkPool::Limits{.name = "lookup queue", .flag = "", .threads = 2, .max_waiting = 100},
        WorkPool::Limits{.name = "render queue", .flag = "", .threads = 1, .max_waiting = 100});
  }
  static std::vector<uint64_t> StepsOf(const v1::DatasetEvent& event) {
    std::vector<uint64_t> steps;
    for (const auto& step : event.steps()) {
      steps.push_back(step.step());
    }
    return steps;
  }
  using Steps = std::vector<uint64_t>;

  std::unique_ptr<Services> services_;
};

TEST_F(WatchStreamTest, TellsOfEveryStepOnceHoweverSlowlyItIsRead) {
  FakeViewer viewer(*services_);
  viewer.Start({"plume", 0, false});
  v1::DatasetEvent event = viewer.Read();
  EXPECT_EQ(event.state(), v1::DatasetEvent::PRESENT);
  EXPECT_EQ(event.committed_steps(), 2U);
  EXPECT_EQ(StepsOf(event), (Steps{0, 1}));
  EXPECT_EQ(event.steps(1).time_ns() - event.steps(0).time_ns(), 1'000'000'000);
  AppendStep("plume");
  services_->steps.Poke("plume");
  viewer.WaitForEvent();  // and does not read it while three more steps come
  for (int i = 0; i < 3; ++i) {
    AppendStep("plume");
  }
  const auto all = std::make_shared<Listener>();
  services_->steps.Subscribe("plume", all);  // told when the viewer has been
  services_->steps.Poke("plume");
  for (size_t i = 0; all->Get(i).committed_steps < 6; ++i) {
  }
  EXPECT_EQ(StepsOf(viewer.Read()), (Steps{2}));
  event = viewer.Read();
  EXPECT_EQ(StepsOf(event), (Steps{3, 4, 5}));
  EXPECT_EQ(event.committed_steps(), 6U);
  viewer.Cancel();
  EXPECT_THAT(viewer.WaitForEnd(), FailsWith(absl::StatusCode::kCancelled, "client"));
}

TEST_F(WatchStreamTest, BeginsWhereItIsTold) {
  FakeViewer viewer(*services_);
  viewer.Start({"plume", 3, false});
  EXPECT_EQ(StepsOf(viewer.Read()), Steps());
  AppendStep("plume");
  AppendStep("plume");
  services_->steps.Poke("plume");
  EXPECT_EQ(StepsOf(viewer.Read()), Steps{3});
  viewer.Cancel();
  EXPECT_FALSE(viewer.WaitForEnd().ok());
}

TEST_F(WatchStreamTest, SaysThatADatasetWentAndCame) {
  FakeViewer viewer(*services_);
  viewer.Start({"plume", 1, false});
  EXPECT_EQ(StepsOf(viewer.Read()), Steps{1});
  ASSERT_OK(store::testing::MakeStore(folder_.Path("new.zarr"), Info(), 3));
  fs::rename(Path("plume"), folder_.Path("gone.zarr"));
  fs::rename(folder_.Path("new.zarr"), Path("plume"));
  services_->steps.Poke("plume");
  v1::DatasetEvent event = viewer.Read();
  EXPECT_EQ(event.state(), v1::DatasetEvent::ABSENT);
  EXPECT_EQ(event.committed_steps(), 0U);
  event = viewer.Read();
  EXPECT_EQ(event.state(), v1::DatasetEvent::PRESENT);
  EXPECT_EQ(StepsOf(event), (Steps{0, 1, 2}));
  viewer.Cancel();
  EXPECT_FALSE(viewer.WaitForEnd().ok());
}

TEST_F(WatchStreamTest, WaitsForADatasetOnlyWhenAsked) {
  FakeViewer hasty(*services_);
  hasty.Start({"later", 0, false});
  EXPECT_THAT(hasty.WaitForEnd(), FailsWith(absl::StatusCode::kNotFound, "later"));
  FakeViewer patient(*services_);
  patient.Start({"later", 0, true});
  EXPECT_EQ(patient.Read().state(), v1::DatasetEvent::ABSENT);
  ASSERT_OK(store::testing::MakeStore(Path("later"), Info(), 1));
  services_->steps.Poke("later");
  EXPECT_EQ(StepsOf(patient.Read()), Steps{0});
  patient.Cancel();
  EXPECT_FALSE(patient.WaitForEnd().ok());
}

TEST_F(WatchStreamTest, EndsWhenTheClientIsLostOrTheServerDrains) {
  FakeViewer lost(*services_);
  lost.Start({"plume", 0, false});
  lost.WaitForEvent();
  lost.Cancel();  // while a message is on its way: ends when that is done
  lost.LoseClient();
  EXPECT_THAT(lost.WaitForEnd(), FailsWith(absl::StatusCode::kCancelled, "client"));
  FakeViewer viewer(*services_);
  viewer.Start({"plume", 0, false});
  viewer.Read();
  services_->steps.Close();
  EXPECT_THAT(viewer.WaitForEnd(), FailsWith(absl::StatusCode::kUnavailable, "shutting down"));
}

}  // namespace
}  // namespace fovea::server
