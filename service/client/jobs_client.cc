#include "service/client/jobs_client.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "engine/base/stopwatch.h"
#include "fovea/v1/ingest.grpc.pb.h"
#include "fovea/v1/jobs.grpc.pb.h"
#include "service/client/channel.h"
#include "service/client/stream_reader.h"
#include "service/frames/frames.h"
#include "service/wire/convert.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::client {
namespace {

/// How long a server may be away before a watch fails.
constexpr double kAwaySeconds = 60;

StatusOr<Job> FromProto(const v1::Job& proto) {
  Job job;
  if (proto.id().empty() || proto.done() > std::numeric_limits<int64_t>::max() ||
      proto.total() > std::numeric_limits<int64_t>::max() ||
      proto.failed() > std::numeric_limits<int64_t>::max() ||
      proto.warning_count() > std::numeric_limits<int64_t>::max()) {
    return Internal("a job without an id, or with too large counts");
  }
  switch (proto.kind()) {
    case v1::Job::INGEST_FILES:
      job.kind = JobKind::kIngestFiles;
      break;
    case v1::Job::EXPORT:
      job.kind = JobKind::kExport;
      break;
    default:
      return Internal("job {} is of no kind", proto.id());
  }
  switch (proto.state()) {
    case v1::Job::QUEUED:
      job.state = JobState::kQueued;
      break;
    case v1::Job::RUNNING:
      job.state = JobState::kRunning;
      break;
    case v1::Job::DONE:
      job.state = JobState::kDone;
      break;
    case v1::Job::FAILED:
      job.state = JobState::kFailed;
      break;
    case v1::Job::CANCELLED:
      job.state = JobState::kCancelled;
      break;
    default:
      return Internal("job {} is in no state", proto.id());
  }
  job.id = proto.id();
  job.dataset = proto.dataset();
  job.target = proto.target();
  job.done = static_cast<int64_t>(proto.done());
  job.total = static_cast<int64_t>(proto.total());
  job.failed = static_cast<int64_t>(proto.failed());
  if (proto.has_seconds_left()) {
    job.seconds_left = proto.seconds_left();
  }
  job.now = proto.now();
  job.message = proto.message();
  for (const v1::Job::Failure& failure : proto.failures()) {
    job.failures.push_back({failure.file(), failure.reason()});
  }
  job.warnings.assign(proto.warnings().begin(), proto.warnings().end());
  job.warning_count = static_cast<int64_t>(proto.warning_count());
  job.created_ms = proto.created_ms();
  if (proto.has_started_ms()) {
    job.started_ms = proto.started_ms();
  }
  if (proto.has_ended_ms()) {
    job.ended_ms = proto.ended_ms();
  }
  return job;
}

v1::IngestFilesRequest ToProto(const IngestRequest& request) {
  using Proto = v1::IngestFilesRequest;
  Proto proto;
  proto.set_dataset(request.dataset);
  for (const std::string& file : request.files) {
    proto.add_files(file);
  }
  proto.set_raw(request.raw);
  for (const std::string& grid : request.grids) {
    proto.add_grids(grid);
  }
  proto.set_field(request.field);
  if (request.frames_per_second) {
    proto.set_frames_per_second(*request.frames_per_second);
  }
  proto.set_on_missing(request.on_missing == IngestRequest::OnMissing::kSkip   ? Proto::SKIP
                       : request.on_missing == IngestRequest::OnMissing::kHold ? Proto::HOLD
                                                                               : Proto::ERROR);
  proto.set_registration(request.registration == IngestRequest::Registration::kIndex ? Proto::INDEX
                         : request.registration == IngestRequest::Registration::kWorld
                             ? Proto::WORLD
                             : Proto::SAME);
  proto.set_wavelet(request.wavelet);
  proto.set_lossless(request.lossless);
  if (request.tolerance) {
    proto.set_tolerance(*request.tolerance);
  }
  return proto;
}

StatusOr<v1::CreateExportRequest> ToProto(const ExportRequest& request) {
  FOVEA_RETURN_IF_ERROR(frames::ValidateSpec(request.spec));
  if (request.first < 0 || request.last.value_or(request.first) < request.first ||
      request.stride < 1) {
    return InvalidArgument(
        "steps: they count from 0, the last is not before the first, and the "
        "stride is at least 1");
  }
  v1::CreateExportRequest proto;
  proto.set_dataset(request.dataset);
  proto.set_output(request.output);
  proto.mutable_steps()->set_first(static_cast<uint64_t>(request.first));
  if (request.last) {
    proto.mutable_steps()->set_last(static_cast<uint64_t>(*request.last));
  }
  proto.mutable_steps()->set_stride(static_cast<uint64_t>(request.stride));
  *proto.mutable_spec() = wire::ToProto(request.spec);
  proto.set_animation_json(request.animation_json);
  if (request.frames_per_second) {
    proto.set_frames_per_second(*request.frames_per_second);
  }
  proto.set_overwrite(request.overwrite);
  return proto;
}

class GrpcJobsClient final : public JobsClient {
 public:
  GrpcJobsClient(Connection connection, double deadline_seconds)
      : connection_(std::move(connection)),
        deadline_seconds_(deadline_seconds),
        ingest_(v1::Ingest::NewStub(connection_.channel)),
        jobs_(v1::Jobs::NewStub(connection_.channel)) {}

  StatusOr<Job> IngestFiles(const IngestRequest& request) override {
    return Ask<v1::Job>(*ingest_, &v1::Ingest::Stub::IngestFiles, ToProto(request), FromProto);
  }
  StatusOr<Job> Export(const ExportRequest& request) override {
    FOVEA_ASSIGN_OR_RETURN(const v1::CreateExportRequest proto, ToProto(request));
    return Ask<v1::Job>(*jobs_, &v1::Jobs::Stub::CreateExport, proto, FromProto);
  }
  StatusOr<Job> Get(const std::string& id) override {
    v1::GetJobRequest proto;
    proto.set_id(id);
    return Ask<v1::Job>(*jobs_, &v1::Jobs::Stub::GetJob, proto, FromProto);
  }
  StatusOr<Job> Cancel(const std::string& id) override {
    v1::CancelJobRequest proto;
    proto.set_id(id);
    return Ask<v1::Job>(*jobs_, &v1::Jobs::Stub::CancelJob, proto, FromProto);
  }
  StatusOr<std::vector<Job>> List(int64_t most) override;
  StatusOr<Job> Watch(const std::string& id, const OnJob& on_job, const GoOn& go_on) override;

 private:
  [[nodiscard]] Status Explain(const Status& status) const {
    return client::Explain(connection_.address, status);
  }
  /// One call, and its answer as `convert` makes it.
  template <typename Response, typename Stub, typename Method, typename Request, typename Convert>
  auto Ask(Stub& stub, Method method, const Request& request, Convert convert) const
      -> decltype(convert(Response())) {
    grpc::ClientContext context;
    connection_.metadata.AddTo(&context);
    context.set_deadline(DeadlineIn(deadline_seconds_));
    Response response;
    FOVEA_RETURN_IF_ERROR(Explain(wire::FromGrpc((stub.*method)(&context, request, &response))));
    auto made = convert(response);
    FOVEA_RETURN_IF_ERROR(Explain(made.status()));
    return made;
  }
  /// One WatchJob, until it ends. `last` is how the job stood; whether on_job or go_on stopped it.
  [[nodiscard]] StatusOr<bool> WatchOnce(const v1::WatchJobRequest& request, const OnJob& on_job,
                                         const GoOn& go_on, std::optional<Job>* last) const;

  const Connection connection_;
  const double deadline_seconds_;
  const std::unique_ptr<v1::Ingest::Stub> ingest_;
  const std::unique_ptr<v1::Jobs::Stub> jobs_;
};

StatusOr<std::vector<Job>> GrpcJobsClient::List(int64_t most) {
  std::vector<Job> jobs;
  v1::ListJobsRequest request;
  while (std::ssize(jobs) < most) {
    request.set_page_size(
        static_cast<uint32_t>(std::min<int64_t>(wire::kMaxPageSize, most - std::ssize(jobs))));
    FOVEA_ASSIGN_OR_RETURN(
        const v1::ListJobsResponse page,
        Ask<v1::ListJobsResponse>(
            *jobs_, &v1::Jobs::Stub::ListJobs, request,
            [](const auto& response) -> StatusOr<v1::ListJobsResponse> { return response; }));
    for (const v1::Job& proto : page.jobs()) {
      auto job = FromProto(proto);
      FOVEA_RETURN_IF_ERROR(Explain(job.status()));
      jobs.push_back(*std::move(job));
    }
    if (page.next_page_token().empty()) {
      break;
    }
    if (page.jobs().empty()) {
      return Explain(Internal("an empty page of jobs that says that more follow"));
    }
    request.set_page_token(page.next_page_token());
  }
  jobs.resize(static_cast<size_t>(std::min<int64_t>(std::ssize(jobs), most)));
  return jobs;
}

StatusOr<bool> GrpcJobsClient::WatchOnce(const v1::WatchJobRequest& request, const OnJob& on_job,
                                         const GoOn& go_on, std::optional<Job>* last) const {
  using Reader = StreamReader<v1::Job>;
  Reader reader(connection_.metadata, Reader::kNoDeadline, go_on, [&](auto* context, auto* queue) {
    return jobs_->PrepareAsyncWatchJob(context, request, queue);
  });
  for (v1::Job message; reader.Next(&message);) {
    FOVEA_ASSIGN_OR_RETURN(*last, FromProto(message));
    if (!on_job(**last)) {
      return true;
    }
  }
  if (reader.stopped()) {
    return true;
  }
  FOVEA_RETURN_IF_ERROR(wire::FromGrpc(reader.Finish()));
  if (!*last || !(*last)->ended()) {
    return Internal("the watch of job {} ended before the job", request.id());
  }
  return false;
}

StatusOr<Job> GrpcJobsClient::Watch(const std::string& id, const OnJob& on_job, const GoOn& go_on) {
  constexpr auto kPause = std::chrono::milliseconds(200);
  v1::WatchJobRequest request;
  request.set_id(id);
  std::optional<Job> last;
  bool came = false;
  Stopwatch since_last;
  const OnJob on_any = [&](const Job& job) {
    came = true;
    return on_job(job);
  };
  while (true) {
    came = false;
    const StatusOr<bool> stopped = WatchOnce(request, on_any, go_on, &last);
    if (stopped.ok() && last) {
      return *last;
    }
    if (stopped.ok()) {
      return Cancelled("stopped before the server said anything of job {}", id);
    }
    if (came) {
      static_cast<void>(since_last.RestartMs());
    }
    if (!absl::IsUnavailable(stopped.status()) || !last ||
        since_last.ElapsedMs() > kAwaySeconds * 1000) {
      return Explain(stopped.status());
    }
    if (go_on && !go_on()) {
      return *last;
    }
    std::this_thread::sleep_for(kPause);  // the job goes on when the server is back
  }
}

}  // namespace

StatusOr<std::unique_ptr<JobsClient>> JobsClient::Connect(const std::string& address,
                                                          const Credentials& credentials,
                                                          double deadline_seconds) {
  FOVEA_ASSIGN_OR_RETURN(Connection connection, OpenConnection(address, credentials));
  return std::make_unique<GrpcJobsClient>(std::move(connection), deadline_seconds);
}

}  // namespace fovea::client
