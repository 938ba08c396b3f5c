#include <fstream>
#include <functional>
#include <set>

#include "fovea/v1/ingest.grpc.pb.h"
#include "fovea/v1/jobs.grpc.pb.h"
#include "service/access/token_file.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

/// "lab" and "other" may write below the folders of their names, "all" everywhere, "reader"
/// nowhere.
class JobsTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    for (const char* folder : {"in/lab", "in/other", "out"}) {
      std::filesystem::create_directories(folder_.Path(folder));
    }
    for (const char* file : {"in/lab/a_0.raw", "in/lab/a_1.raw", "in/other/b.raw"}) {
      std::ofstream(folder_.Path(file)) << std::string(16 * 16 * 16, 'x');
    }
    std::vector<access::Token> tokens;
    for (const char* name : {"lab", "other", "all", "reader"}) {
      access::Token token;
      token.name = name;
      token.digest = access::DigestOf(std::string("secret-of-") + name);
      token.prefix = name == std::string("lab") || name == std::string("other") ? name : "";
      token.right = name == std::string("reader") ? access::Right::kRead : access::Right::kWrite;
      tokens.push_back(token);
    }
    ASSERT_OK(access::WriteTokenFile(folder_.Path("tokens.json"), tokens));
    options_.root = Root();
    options_.listen = "127.0.0.1:0";
    options_.threads = 2;
    options_.rescan_interval = std::chrono::milliseconds(0);
    options_.tokens = folder_.Path("tokens.json");
    options_.state = folder_.Path("state");
    options_.ingest_root = folder_.Path("in");
    options_.export_root = folder_.Path("out");
  }
  void Start() {
    server_.reset();
    auto server = Server::Start(options_);
    ASSERT_OK(server.status());
    server_ = *std::move(server);
    channel_ = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
    ingest_ = v1::Ingest::NewStub(channel_);
    jobs_ = v1::Jobs::NewStub(channel_);
  }

  template <typename Stub, typename Request, typename Response>
  static StatusOr<Response> Call(Stub* stub,
                                 grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&,
                                                              Response*),
                                 const std::string& token, const Request& request) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "Bearer secret-of-" + token);
    Response response;
    FOVEA_RETURN_IF_ERROR(wire::FromGrpc((stub->*method)(&context, request, &response)));
    return response;
  }
  static v1::IngestFilesRequest LabIngest() {
    v1::IngestFilesRequest request;
    request.set_dataset("lab/made");
    request.add_files("lab/a_#.raw");
    request.set_raw("16x16x16:uint8");
    return request;
  }
  static v1::CreateExportRequest PlumeExport() {
    v1::CreateExportRequest request;
    request.set_dataset("plume");
    request.set_output("shot/f.##.png");
    *request.mutable_spec() = SmallSpec(v1::PNG, 16);
    return request;
  }
  StatusOr<v1::Job> Ingest(const std::string& token, const v1::IngestFilesRequest& request) {
    return Call<v1::Ingest::StubInterface>(ingest_.get(), &v1::Ingest::StubInterface::IngestFiles,
                                           token, request);
  }
  StatusOr<v1::Job> Export(const std::string& token, const v1::CreateExportRequest& request) {
    return Call<v1::Jobs::StubInterface>(jobs_.get(), &v1::Jobs::StubInterface::CreateExport, token,
                                         request);
  }
  StatusOr<v1::Job> Get(const std::string& token, const std::string& id) {
    v1::GetJobRequest request;
    request.set_id(id);
    return Call<v1::Jobs::StubInterface>(jobs_.get(), &v1::Jobs::StubInterface::GetJob, token,
                                         request);
  }
  StatusOr<v1::Job> Cancel(const std::string& token, const std::string& id) {
    v1::CancelJobRequest request;
    request.set_id(id);
    return Call<v1::Jobs::StubInterface>(jobs_.get(), &v1::Jobs::StubInterface::CancelJob, token,
                                         request);
  }
  /// The last message of a watch, or how it failed.
  StatusOr<v1::Job> Watch(const std::string& token, const std::string& id) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "Bearer secret-of-" + token);
    v1::WatchJobRequest request;
    request.set_id(id);
    const auto reader = jobs_->WatchJob(&context, request);
    v1::Job last;
    for (v1::Job job; reader->Read(&job);) {
      last = job;
    }
    FOVEA_RETURN_IF_ERROR(wire::FromGrpc(reader->Finish()));
    return last;
  }

  ServerOptions options_;
  std::unique_ptr<v1::Ingest::Stub> ingest_;
  std::unique_ptr<v1::Jobs::Stub> jobs_;
};

TEST_F(JobsTest, AJobKeepsItsDataset) {
  Start();
  datasets_ = v1::Datasets::NewStub(channel_);
  const auto remove = [&](const std::string& token) {
    v1::DeleteDatasetRequest request;
    request.set_dataset("lab/other");
    return Call<v1::Datasets::StubInterface>(
               datasets_.get(), &v1::Datasets::StubInterface::DeleteDataset, token, request)
        .status();
  };
  v1::CreateExportRequest request = PlumeExport();
  request.set_dataset("lab/other");
  request.set_output("lab/f.##.png");
  *request.mutable_spec() = SmallSpec(v1::PNG, 2048);  // for a while
  const auto job = Export("lab", request);
  ASSERT_OK(job.status());
  EXPECT_THAT(remove("lab"), FailsWith(absl::StatusCode::kFailedPrecondition, job->id().c_str()));
  EXPECT_THAT(remove("all"), FailsWith(absl::StatusCode::kFailedPrecondition, "another token"));
  ASSERT_OK(Cancel("lab", job->id()).status());
  ASSERT_OK(Watch("lab", job->id()).status());
  EXPECT_OK(remove("lab"));
  EXPECT_FALSE(std::filesystem::exists(Root() + "/lab/other.zarr"));
}

TEST_F(JobsTest, FilesBecomeADatasetAndADatasetBecomesFiles) {
  Start();
  const auto ingest = Ingest("lab", LabIngest());
  ASSERT_OK(ingest.status());
  EXPECT_EQ(ingest->state(), v1::Job::QUEUED);
  EXPECT_EQ(ingest->kind(), v1::Job::INGEST_FILES);
  const auto made = Watch("lab", ingest->id());
  ASSERT_OK(made.status());
  EXPECT_EQ(made->state(), v1::Job::DONE) << made->message();
  EXPECT_EQ(made->done(), 2);
  EXPECT_EQ(made->total(), 2);
  EXPECT_GE(made->ended_ms(), made->started_ms());
  const auto dataset = store::Dataset::Open(Root() + "/lab/made.zarr");
  ASSERT_OK(dataset.status());
  EXPECT_EQ((*dataset)->info().committed_steps, 2);

  const auto shot = Export("all", PlumeExport());
  ASSERT_OK(shot.status());
  EXPECT_EQ(shot->target(), "shot/f.##.png");
  const auto drawn = Watch("all", shot->id());
  ASSERT_OK(drawn.status());
  EXPECT_EQ(drawn->state(), v1::Job::DONE) << drawn->message();
  EXPECT_EQ(drawn->done(), kSteps);
  EXPECT_EQ(drawn->failed(), 0);
  const auto frame = InProcess(Root() + "/plume.zarr", 1, SmallSpec(v1::PNG, 16));
  std::ifstream file(folder_.Path("out/shot/f.01.png"), std::ios::binary);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}), frame->pixels);
  EXPECT_EQ(Watch("all", shot->id())->state(), v1::Job::DONE);  // also after the end
}

TEST_F(JobsTest, JobsAreTheirTokens) {
  Start();
  const auto job = Ingest("lab", LabIngest());
  ASSERT_OK(job.status());
  EXPECT_OK(Get("lab", job->id()).status());
  for (const char* token : {"other", "all", "reader"}) {
    EXPECT_THAT(Get(token, job->id()), FailsWith(absl::StatusCode::kNotFound, job->id().c_str()));
    EXPECT_THAT(Watch(token, job->id()), FailsWith(absl::StatusCode::kNotFound, "no job"));
  }
  EXPECT_THAT(Cancel("other", job->id()), FailsWith(absl::StatusCode::kNotFound, "no job"));
  EXPECT_EQ(Get("other", job->id()).status(), Get("other", job->id()).status());
  EXPECT_THAT(Cancel("reader", job->id()), FailsWith(absl::StatusCode::kPermissionDenied, ""));
  EXPECT_THAT(Ingest("reader", LabIngest()), FailsWith(absl::StatusCode::kPermissionDenied, ""));
  EXPECT_THAT(Export("reader", PlumeExport()), FailsWith(absl::StatusCode::kPermissionDenied, ""));
  EXPECT_EQ(Watch("lab", job->id())->state(), v1::Job::DONE);
}

TEST_F(JobsTest, PrefixesHoldForFilesToo) {
  Start();
  v1::IngestFilesRequest request = LabIngest();
  request.set_files(0, "other/b.raw");
  EXPECT_THAT(Ingest("lab", request), FailsWith(absl::StatusCode::kNotFound, "other/b.raw"));
  EXPECT_OK(Ingest("all", request).status());
  EXPECT_THAT(Export("lab", PlumeExport()), FailsWith(absl::StatusCode::kNotFound, "plume"));
  v1::CreateExportRequest shot = PlumeExport();
  shot.set_dataset("lab/other");
  EXPECT_THAT(Export("lab", shot),
              FailsWith(absl::StatusCode::kInvalidArgument, "not below the folder 'lab'"));
  EXPECT_EQ(wire::FieldOf(Export("lab", shot).status()), "output");
  shot.set_output("lab/f.##.png");
  EXPECT_OK(Export("lab", shot).status());
}

TEST_F(JobsTest, WrongRequestsNameTheFieldAndNothingLeadsOut) {
  Start();
  std::filesystem::create_directory_symlink(folder_.Path("."), folder_.Path("in/up"));
  std::filesystem::create_directory_symlink(folder_.Path("."), folder_.Path("out/up"));
  for (const char* name : {"../tokens.json", "/etc/passwd", "up/tokens.json", ".hidden", "",
                           "none.raw", "lab/none.raw", "none/a_#.raw", "up/a_#.raw"}) {
    v1::IngestFilesRequest request = LabIngest();
    request.set_files(0, name);
    EXPECT_THAT(Ingest("all", request), FailsWith(absl::StatusCode::kNotFound, "is not there"));
  }
  for (const auto& [name, why] : std::vector<std::pair<const char*, const char*>>{
           {"../f.##.png", "not below the server's export root"},
           {"/tmp/f.##.png", "not below the server's export root"},
           {"up/f.mp4", "not below the server's export root"},
           {"a/.f.##.png", "not below the server's export root"},
           {"a b.##.png", "not below the server's export root"},
           {"plume.zarr/density/c.##.png", "is a dataset's"},
           {"f.##.xyz", ".mp4 .mov .webm"},
           {"", "''"}}) {
    v1::CreateExportRequest request = PlumeExport();
    request.set_output(name);
    const Status status = Export("all", request).status();
    EXPECT_THAT(status, FailsWith(absl::StatusCode::kInvalidArgument, why));
    EXPECT_EQ(wire::FieldOf(status), "output");
  }
  struct Wrong {
    const char* field;
    std::function<void(v1::IngestFilesRequest*)> make;
  };
  const std::vector<Wrong> wrongs = {
      {"dataset", [](auto* r) { r->set_dataset("../x"); }},
      {"files", [](auto* r) { r->clear_files(); }},
      {"files", [](auto* r) { r->set_files(0, "*/x.raw"); }},
      {"raw", [](auto* r) { r->set_raw("16x16"); }},
      {"wavelet", [](auto* r) { r->set_wavelet("daubechies"); }},
      {"tolerance", [](auto* r) { r->set_tolerance(0); }},
      {"frames_per_second", [](auto* r) { r->set_frames_per_second(-1); }},
      {"on_missing", [](auto* r) { r->set_on_missing(v1::IngestFilesRequest::OnMissing(9)); }},
  };
  for (const Wrong& wrong : wrongs) {
    v1::IngestFilesRequest request = LabIngest();
    wrong.make(&request);
    const Status status = Ingest("all", request).status();
    EXPECT_THAT(status, FailsWith(absl::StatusCode::kInvalidArgument, wrong.field));
    EXPECT_EQ(wire::FieldOf(status), wrong.field);
  }
  v1::CreateExportRequest shot = PlumeExport();
  shot.set_output("f.png");
  EXPECT_EQ(wire::FieldOf(Export("all", shot).status()), "output");
  shot = PlumeExport();
  shot.mutable_steps()->set_last(99);
  EXPECT_THAT(Export("all", shot), FailsWith(absl::StatusCode::kOutOfRange, "99"));
  shot = PlumeExport();
  shot.set_animation_json("{");
  EXPECT_EQ(wire::FieldOf(Export("all", shot).status()), "animation_json");
  EXPECT_EQ(wire::FieldOf(Get("all", "").status()), "id");
  EXPECT_EQ(wire::FieldOf(Watch("all", "").status()), "id");
}

TEST_F(JobsTest, PagesHoldEveryJobOnceNewestFirst) {
  Start();
  std::vector<std::string> made;
  for (int i = 0; i < 5; ++i) {
    const auto job = Ingest("lab", LabIngest());
    ASSERT_OK(job.status());
    made.insert(made.begin(), job->id());
  }
  std::vector<std::string> listed;
  v1::ListJobsRequest request;
  request.set_page_size(2);
  int pages = 0;
  do {
    const auto page = Call<v1::Jobs::StubInterface>(jobs_.get(), &v1::Jobs::StubInterface::ListJobs,
                                                    "lab", request);
    ASSERT_OK(page.status());
    ++pages;
    for (const v1::Job& job : page->jobs()) {
      listed.push_back(job.id());
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  EXPECT_EQ(pages, 3);
  EXPECT_EQ(listed, made);
  for (const char* token : {"x", "after:", "after:x", "after:-1"}) {
    request.set_page_token(token);
    EXPECT_EQ(wire::FieldOf(Call<v1::Jobs::StubInterface>(
                                jobs_.get(), &v1::Jobs::StubInterface::ListJobs, "lab", request)
                                .status()),
              "page_token")
        << token;
  }
}

TEST_F(JobsTest, WithoutAFlagItSaysWhich) {
  options_.ingest_root = options_.export_root = "";
  Start();
  EXPECT_THAT(Ingest("lab", LabIngest()),
              FailsWith(absl::StatusCode::kFailedPrecondition, "--ingest-root"));
  EXPECT_THAT(Export("all", PlumeExport()),
              FailsWith(absl::StatusCode::kFailedPrecondition, "--export-root"));
  options_.state = "";
  Start();
  for (const Status& status : {Ingest("lab", LabIngest()).status(), Get("lab", "x").status(),
                               Watch("lab", "x").status(), Cancel("lab", "x").status()}) {
    EXPECT_THAT(status, FailsWith(absl::StatusCode::kFailedPrecondition, "--state"));
  }
  options_.export_root = folder_.Path("out");
  EXPECT_THAT(Server::Start(options_).status(),
              FailsWith(absl::StatusCode::kInvalidArgument, "--state"));
}

}  // namespace
}  // namespace fovea::server
