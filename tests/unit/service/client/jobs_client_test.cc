#include "service/client/jobs_client.h"

#include <fstream>
#include <vector>

#include <gmock/gmock.h>

#include "fovea/v1/jobs.grpc.pb.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::client {
namespace {

using ::fovea::testing::FailsWith;

class JobsClientTest : public server::ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    for (const char* folder : {"in", "out", "state"}) {
      std::filesystem::create_directories(folder_.Path(folder));
    }
    std::ofstream(folder_.Path("in/a_0.raw")) << std::string(16 * 16 * 16, 'x');
  }
  void Start() {
    server::ServerOptions options;
    options.root = Root();
    options.listen = "127.0.0.1:0";
    options.threads = 2;
    options.allow_ingest = true;
    options.state = folder_.Path("state");
    options.ingest_root = folder_.Path("in");
    options.export_root = folder_.Path("out");
    ASSERT_OK_AND_ASSIGN(server_, server::Server::Start(options));
    ASSERT_OK_AND_ASSIGN(client_, JobsClient::Connect(server_->address()));
  }
  static IngestRequest Ingest() {
    IngestRequest request;
    request.dataset = "made";
    request.files = {"a_#.raw"};
    request.raw = "16x16x16:uint8";
    return request;
  }

  std::unique_ptr<JobsClient> client_;
};

TEST_F(JobsClientTest, AWatchEndsWithTheJobOrWhenItIsTold) {
  Start();
  ASSERT_OK_AND_ASSIGN(const Job begun, client_->IngestFiles(Ingest()));
  EXPECT_EQ(begun.state, JobState::kQueued);
  EXPECT_EQ(begun.kind, JobKind::kIngestFiles);
  int told = 0;
  ASSERT_OK_AND_ASSIGN(const Job first, client_->Watch(begun.id, [&](const Job&) {
    ++told;
    return false;
  }));
  EXPECT_EQ(told, 1);
  EXPECT_EQ(first.id, begun.id);
  ASSERT_OK_AND_ASSIGN(const Job last, client_->Watch(begun.id, [](const Job&) { return true; }));
  EXPECT_EQ(last.state, JobState::kDone) << last.message;
  EXPECT_EQ(last.done, 1);
  ASSERT_OK_AND_ASSIGN(const Job again, client_->Get(begun.id));
  EXPECT_EQ(again.ended_ms, last.ended_ms);
  ASSERT_OK_AND_ASSIGN(const Job left, client_->Cancel(begun.id));
  EXPECT_EQ(left.state, JobState::kDone);  // it had ended
}

TEST_F(JobsClientTest, ErrorsAreTheServersAndSayWhich) {
  Start();
  for (const Status& status : {client_->Get("x").status(), client_->Cancel("x").status(),
                               client_->Watch("x", [](const Job&) { return true; }).status()}) {
    EXPECT_THAT(status, FailsWith(absl::StatusCode::kNotFound, "there is no job 'x'"));
    EXPECT_THAT(status, FailsWith(absl::StatusCode::kNotFound, server_->address()));
  }
  IngestRequest ingest = Ingest();
  ingest.wavelet = "daubechies";
  EXPECT_THAT(client_->IngestFiles(ingest),
              FailsWith(absl::StatusCode::kInvalidArgument, "wavelet"));
  ExportRequest shot;
  shot.dataset = "plume";
  shot.output = "f.#.png";
  shot.stride = 0;
  EXPECT_THAT(client_->Export(shot), FailsWith(absl::StatusCode::kInvalidArgument, "steps"));
  const std::string address = server_->address();
  server_.reset();
  EXPECT_THAT(client_->Watch("x", [](const Job&) { return true; }),
              FailsWith(absl::StatusCode::kUnavailable, address.c_str()));
}

/// A server that says what a test tells it to.
class FakeJobs final : public v1::Jobs::Service {
 public:
  FakeJobs() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }
  [[nodiscard]] const std::string& address() const { return address_; }

  static v1::Job Job(int number) {
    v1::Job job;
    job.set_id(fmt::format("job-{}", number));
    job.set_kind(v1::Job::EXPORT);
    job.set_state(v1::Job::FAILED);
    job.set_dataset("plume");
    job.set_target("f.#.png");
    job.set_done(3);
    job.set_total(7);
    job.set_failed(2);
    job.set_seconds_left(1.5);
    job.set_now("f.3.png");
    job.set_message("why");
    job.set_created_ms(1000 + number);
    job.set_started_ms(2000 + number);
    job.set_ended_ms(3000 + number);
    v1::Job::Failure* failure = job.add_failures();
    failure->set_file("f.2.png");
    failure->set_reason("damaged");
    return job;
  }
  grpc::Status GetJob(grpc::ServerContext* /*context*/, const v1::GetJobRequest* /*request*/,
                      v1::Job* job) override {
    *job = job_;
    return grpc::Status::OK;
  }
  /// Pages of two.
  grpc::Status ListJobs(grpc::ServerContext* /*context*/, const v1::ListJobsRequest* request,
                        v1::ListJobsResponse* response) override {
    const int first = request->page_token().empty() ? 0 : std::stoi(request->page_token());
    for (int i = first;
         i < std::min({first + 2, first + static_cast<int>(request->page_size()), jobs_}); ++i) {
      *response->add_jobs() = Job(i);
    }
    if (first + 2 < jobs_) {
      response->set_next_page_token(std::to_string(first + 2));
    }
    return grpc::Status::OK;
  }
  grpc::Status WatchJob(grpc::ServerContext* /*context*/, const v1::WatchJobRequest* /*request*/,
                        grpc::ServerWriter<v1::Job>* writer) override {
    v1::Job job = Job(0);
    job.set_state(v1::Job::RUNNING);
    writer->Write(job);
    if (++watches_ < 3) {
      return {grpc::StatusCode::UNAVAILABLE, "shuts down"};
    }
    job.set_state(v1::Job::DONE);
    writer->Write(ends_ ? job : v1::Job());
    return grpc::Status::OK;
  }

  v1::Job job_;
  int jobs_ = 5;
  int watches_ = 0;
  bool ends_ = true;

 private:
  std::string address_;
  std::unique_ptr<grpc::Server> server_;
};

TEST(JobsClientCheckTest, AListIsWholeAcrossPagesAndNoLongerThanAsked) {
  FakeJobs fake;
  ASSERT_OK_AND_ASSIGN(const auto client, JobsClient::Connect(fake.address()));
  ASSERT_OK_AND_ASSIGN(const std::vector<Job> all, client->List());
  ASSERT_EQ(all.size(), 5);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(all[i].id, fmt::format("job-{}", i));
  }
  const Job& last = all.back();
  EXPECT_EQ(last.kind, JobKind::kExport);
  EXPECT_EQ(last.state, JobState::kFailed);
  EXPECT_TRUE(last.ended());
  EXPECT_EQ(last.dataset, "plume");
  EXPECT_EQ(last.target, "f.#.png");
  EXPECT_EQ(last.message, "why");
  EXPECT_EQ(last.now, "f.3.png");
  EXPECT_EQ(last.done, 3);
  EXPECT_EQ(last.total, 7);
  EXPECT_EQ(last.failed, 2);
  EXPECT_EQ(last.seconds_left, 1.5);
  EXPECT_EQ(last.created_ms, 1004);
  EXPECT_EQ(last.started_ms, 2004);
  EXPECT_EQ(last.ended_ms, 3004);
  ASSERT_EQ(last.failures.size(), 1);
  EXPECT_EQ(last.failures[0].file + last.failures[0].reason, "f.2.pngdamaged");
  for (const int64_t most : {0, 1, 2, 3, 5}) {
    ASSERT_OK_AND_ASSIGN(const std::vector<Job> some, client->List(most));
    EXPECT_EQ(std::ssize(some), most);
  }
}

TEST(JobsClientCheckTest, AWatchGoesOnWhereTheServerComesBack) {
  FakeJobs fake;
  ASSERT_OK_AND_ASSIGN(const auto client, JobsClient::Connect(fake.address()));
  ASSERT_OK_AND_ASSIGN(const Job job, client->Watch("job-0", [](const Job&) { return true; }));
  EXPECT_EQ(job.state, JobState::kDone);
  EXPECT_EQ(fake.watches_, 3);
}

TEST(JobsClientCheckTest, AJobThatCannotBeIsNotPassedOn) {
  FakeJobs fake;
  ASSERT_OK_AND_ASSIGN(const auto client, JobsClient::Connect(fake.address()));
  fake.job_ = FakeJobs::Job(0);
  EXPECT_OK(client->Get("job-0").status());
  const auto refused = [&](const char* text) {
    EXPECT_THAT(client->Get("job-0"), FailsWith(absl::StatusCode::kInternal, text));
    fake.job_ = FakeJobs::Job(0);
  };
  fake.job_.clear_state();
  refused("no state");
  fake.job_.clear_kind();
  refused("no kind");
  fake.job_.clear_id();
  refused("without an id");
  fake.job_.set_done(uint64_t{1} << 63);
  refused("too large");
  fake.ends_ = false;
  EXPECT_THAT(client->Watch("job-0", [](const Job&) { return true; }),
              FailsWith(absl::StatusCode::kInternal, "without an id"));
}

}  // namespace
}  // namespace fovea::client
