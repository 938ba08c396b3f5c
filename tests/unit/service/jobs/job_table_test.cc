#include "service/jobs/job_table.h"

#include <fstream>
#include <limits>

#include <sqlite3.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::jobs {
namespace {

using ::fovea::testing::FailsWith;
constexpr int64_t kNewest = std::numeric_limits<int64_t>::max();

class JobTableTest : public ::testing::Test {
 protected:
  void SetUp() override { Reopen(); }
  void Reopen() {
    table_.reset();
    auto table = JobTable::Open(Path());
    ASSERT_OK(table.status());
    table_ = *std::move(table);
  }
  [[nodiscard]] std::string Path() const { return folder_ / "jobs.sqlite"; }
  Job Add(const std::string& id, const std::string& owner) {
    Job job;
    job.id = id;
    job.owner = owner;
    job.kind = Kind::kExport;
    job.dataset = "plume";
    job.target = "f.##.png";
    job.request = std::string("bytes\0of it", 11);
    job.created_ms = 17;
    EXPECT_OK(table_->Insert(&job));
    return job;
  }
  std::vector<std::string> Ids(const std::string& owner, int64_t before, int64_t limit) {
    std::vector<std::string> ids;
    const auto jobs = table_->List(owner, before, limit);
    EXPECT_OK(jobs.status());
    for (const Job& job : jobs.value()) {
      ids.push_back(job.id);
    }
    return ids;
  }
  testing::TemporaryFolder folder_;
  std::unique_ptr<JobTable> table_;
};

TEST_F(JobTableTest, AJobComesBackAfterAReopening) {
  Job job = Add("one", "lab");
  job.state = State::kFailed;
  job.progress = {3, 9, 2};
  job.message = "it's; \"why\"";
  job.failures = {{"a", "x"}, {"b", "y"}};
  job.warnings = {"one; 'of' them", "two"};
  job.started_ms = 18;
  job.ended_ms = 19;
  ASSERT_OK(table_->Update(job, 0));
  Reopen();
  const auto back = table_->Get("one");
  ASSERT_OK(back.status());
  EXPECT_EQ(back->number, job.number);
  EXPECT_EQ(back->kind, Kind::kExport);
  EXPECT_EQ(back->state, State::kFailed);
  EXPECT_EQ(back->owner, "lab");
  EXPECT_EQ(back->dataset, "plume");
  EXPECT_EQ(back->target, "f.##.png");
  EXPECT_EQ(back->request, job.request);
  EXPECT_EQ(back->progress, job.progress);
  EXPECT_EQ(back->message, job.message);
  EXPECT_EQ(back->failures, job.failures);
  EXPECT_EQ(back->warnings, job.warnings);
  EXPECT_EQ(back->request, job.request);
  EXPECT_EQ(back->created_ms, 17);
  EXPECT_EQ(back->started_ms, 18);
  EXPECT_EQ(back->ended_ms, 19);
  EXPECT_THAT(table_->Get("two"), FailsWith(absl::StatusCode::kNotFound, "two"));
}

TEST_F(JobTableTest, FailuresAreAddedAndBegunAgain) {
  Job job = Add("one", "");
  job.failures = {{"a", "x"}};
  ASSERT_OK(table_->Update(job, 0));
  job.failures.push_back({"b", "y"});
  ASSERT_OK(table_->Update(job, 1));
  EXPECT_EQ(table_->Get("one")->failures, job.failures);
  job.failures.clear();
  ASSERT_OK(table_->Update(job, 0));
  EXPECT_TRUE(table_->Get("one")->failures.empty());
}

TEST_F(JobTableTest, PagesAreNewestFirstAndOneOwners) {
  for (int i = 0; i < 5; ++i) {
    Add("a" + std::to_string(i), "a");
    Add("b" + std::to_string(i), "b");
  }
  EXPECT_EQ(Ids("a", kNewest, 2), (std::vector<std::string>{"a4", "a3"}));
  EXPECT_EQ(Ids("a", table_->Get("a3")->number, 9), (std::vector<std::string>{"a2", "a1", "a0"}));
  EXPECT_TRUE(Ids("c", kNewest, 9).empty());
}

TEST_F(JobTableTest, WhatHasNotEndedIsFoundAndWhatHasIsPruned) {
  for (int i = 0; i < 6; ++i) {
    Job job = Add(std::to_string(i), "");
    job.state = i == 0 ? State::kRunning : i == 5 ? State::kQueued : State::kDone;
    job.failures = {{"f", "r"}};
    ASSERT_OK(table_->Update(job, 0));
  }
  ASSERT_OK(table_->Prune(2));
  EXPECT_EQ(Ids("", kNewest, 9), (std::vector<std::string>{"5", "4", "3", "0"}));
  const auto unended = table_->Unended();
  ASSERT_EQ(unended->size(), 2);
  EXPECT_EQ(unended->at(0).id, "0");
  EXPECT_EQ(unended->at(1).request, std::string("bytes\0of it", 11));
}

TEST_F(JobTableTest, ATableOfTheVersionBeforeIsTakenOver) {
  Job job = Add("old", "lab");
  table_.reset();
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(Path().c_str(), &database), SQLITE_OK);
  EXPECT_EQ(
      sqlite3_exec(database, "ALTER TABLE jobs DROP COLUMN warnings; PRAGMA user_version = 1;",
                   nullptr, nullptr, nullptr),
      SQLITE_OK);
  sqlite3_close(database);
  Reopen();
  job.warnings = {"new"};
  ASSERT_OK(table_->Update(job, 0));
  Reopen();
  const auto unended = table_->Unended();
  ASSERT_EQ(unended->size(), 1);
  EXPECT_EQ(unended->at(0).warnings, job.warnings);
  EXPECT_EQ(unended->at(0).request, job.request);
}

TEST_F(JobTableTest, WhatIsNoTableIsRefusedAndKept) {
  table_.reset();
  std::ofstream(Path(), std::ios::trunc) << std::string(5000, 'x');
  EXPECT_THAT(JobTable::Open(Path()).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "jobs.sqlite"));
  EXPECT_EQ(testing::ReadFile(Path()), std::string(5000, 'x'));
}

}  // namespace
}  // namespace fovea::jobs
