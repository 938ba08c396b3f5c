#include "service/client/client.h"

#include <thread>
#include <utility>

#include "fovea/v1/coefficients.grpc.pb.h"
#include "fovea/v1/datasets.grpc.pb.h"
#include "fovea/v1/ingest.grpc.pb.h"
#include "fovea/v1/render.grpc.pb.h"
#include "service/client/call_options.h"
#include "service/client/channel.h"
#include "service/client/frame_reader.h"
#include "service/client/reading_sender_impl.h"
#include "service/client/stream_reader.h"
#include "service/client/upload_call.h"
#include "service/frames/frames.h"
#include "service/wire/coefficients.h"
#include "service/wire/convert.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::client {

namespace {

/// A client waits this long, at most, where the server says when it will have room again.
constexpr auto kLongestRetry = std::chrono::seconds(10);

/// What can be known to be wrong before anything is sent.
Status CheckRequest(int64_t step, const frames::FrameSpec& spec) {
  if (step < 0) {
    return InvalidArgument("step {}: steps count from 0", step);
  }
  return frames::ValidateSpec(spec);
}

v1::RenderSequenceRequest ToProto(const SequenceRequest& request) {
  v1::RenderSequenceRequest proto;
  proto.set_dataset(request.dataset);
  proto.mutable_steps()->set_first(static_cast<uint64_t>(request.first));
  if (request.last) {
    proto.mutable_steps()->set_last(static_cast<uint64_t>(*request.last));
  }
  proto.mutable_steps()->set_stride(static_cast<uint64_t>(request.stride));
  *proto.mutable_spec() = wire::ToProto(request.spec);
  if (request.follow) {
    proto.set_follow(true);
    if (request.first == 0) {
      proto.clear_steps();
    }
  }
  proto.set_start_index(request.start_index);
  proto.set_window(request.window);
  if (request.path) {
    *proto.mutable_path() = wire::ToProto(*request.path);
  }
  return proto;
}

StatusOr<DatasetEvent> FromProto(const v1::DatasetEvent& proto) {
  DatasetEvent event;
  event.present = proto.state() == v1::DatasetEvent::PRESENT;
  event.committed_steps = static_cast<int64_t>(proto.committed_steps());
  if (event.committed_steps < 0 || proto.state() == v1::DatasetEvent::STATE_UNSPECIFIED) {
    return Internal("an event of no state, or of {} steps", proto.committed_steps());
  }
  for (const v1::DatasetEvent::Step& from : proto.steps()) {
    if (from.step() >= proto.committed_steps()) {
      return Internal("an event of step {} where {} are committed", from.step(),
                      proto.committed_steps());
    }
    DatasetEvent::Step& step = event.steps.emplace_back();
    step.step = static_cast<int64_t>(from.step());
    step.time_ns = from.time_ns();
    if (from.has_frame_number()) {
      step.frame_number = from.frame_number();
    }
  }
  return event;
}

class GrpcClient final : public Client {
 public:
  GrpcClient(Connection connection, double deadline_seconds)
      : address_(std::move(connection.address)),
        deadline_seconds_(deadline_seconds),
        metadata_(std::move(connection.metadata)),
        channel_(std::move(connection.channel)),
        datasets_(v1::Datasets::NewStub(channel_)),
        ingest_(v1::Ingest::NewStub(channel_)),
        render_(v1::Render::NewStub(channel_)),
        coefficients_(v1::Coefficients::NewStub(channel_)) {}

  StatusOr<std::vector<DatasetSummary>> ListDatasets() override;
  StatusOr<DatasetSummary> GetDataset(const std::string& dataset) override;
  Status DeleteDataset(const std::string& dataset) override;
  StatusOr<frames::Frame> RenderFrame(const std::string& dataset, int64_t step,
                                      const frames::FrameSpec& spec) override;
  StatusOr<frames::FramePlan> PlanFrame(const std::string& dataset, int64_t step,
                                        const frames::FrameSpec& spec,
                                        const frames::FrameBudget& budget) override;
  Status RenderSequence(const SequenceRequest& request,
                        const std::function<bool(const frames::Frame&)>& on_frame) override;
  Status StreamCoefficients(
      const wire::CoefficientsRequest& request,
      const std::function<Status(const wire::CoefficientsMessage&)>& on_message) override;
  Status WatchDataset(const WatchRequest& request, const OnEvent& on_event,
                      const GoOn& go_on) override;
  StatusOr<UploadAnswer> UploadStep(const UploadSpec& spec, const GiveVoxels& give) override;
  StatusOr<std::unique_ptr<ReadingSender>> SendReadings(const ReadingsSpec& spec,
                                                        OnHeld on_held) override;

 private:
  using OnFrame = std::function<bool(const frames::Frame&)>;
  /// How far a stream has come.
  struct Progress {
    uint64_t next_index = 0;
    frames::FrameSpec used;  // of the last frame
    bool stopped = false;    // by on_frame
  };

  void Prepare(grpc::ClientContext* context) const {
    metadata_.AddTo(context);
    context->set_deadline(DeadlineIn(deadline_seconds_));
  }
  [[nodiscard]] Status Explain(const Status& status) const {
    return client::Explain(address_, status);
  }
  [[nodiscard]] Status Stream(const v1::RenderSequenceRequest& request, const OnFrame& on_frame,
                              Progress* progress);
  /// The frame of this index, or, of a stream that may skip, one after it.
  [[nodiscard]] StatusOr<frames::Frame> Receive(v1::Frame proto, uint64_t index,
                                                bool may_skip) const;

  const std::string address_;
  const double deadline_seconds_;
  const CallMetadata metadata_;
  const std::shared_ptr<grpc::Channel> channel_;
  const std::unique_ptr<v1::Datasets::Stub> datasets_;
  const std::unique_ptr<v1::Ingest::Stub> ingest_;
  const std::unique_ptr<v1::Render::Stub> render_;
  const std::unique_ptr<v1::Coefficients::Stub> coefficients_;
};

StatusOr<std::vector<DatasetSummary>> GrpcClient::ListDatasets() {
  std::vector<DatasetSummary> datasets;
  v1::ListDatasetsRequest request;
  request.set_page_size(wire::kMaxPageSize);
  do {
    grpc::ClientContext context;
    Prepare(&context);
    v1::ListDatasetsResponse response;
    FOVEA_RETURN_IF_ERROR(
        Explain(wire::FromGrpc(datasets_->ListDatasets(&context, request, &response))));
    for (const v1::Dataset& proto : response.datasets()) {
      auto summary = wire::FromProto(proto);
      FOVEA_RETURN_IF_ERROR(Explain(summary.status()));
      datasets.push_back(*std::move(summary));
    }
    if (response.datasets().empty() && !response.next_page_token().empty()) {
      return Explain(Internal("an empty page of datasets that says that more follow"));
    }
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  return datasets;
}

StatusOr<DatasetSummary> GrpcClient::GetDataset(const std::string& dataset) {
  grpc::ClientContext context;
  Prepare(&context);
  v1::GetDatasetRequest request;
  request.set_dataset(dataset);
  v1::Dataset response;
  FOVEA_RETURN_IF_ERROR(
      Explain(wire::FromGrpc(datasets_->GetDataset(&context, request, &response))));
  auto summary = wire::FromProto(response);
  FOVEA_RETURN_IF_ERROR(Explain(summary.status()));
  return summary;
}

Status GrpcClient::DeleteDataset(const std::string& dataset) {
  grpc::ClientContext context;
  Prepare(&context);
  v1::DeleteDatasetRequest request;
  request.set_dataset(dataset);
  v1::DeleteDatasetResponse response;
  return Explain(wire::FromGrpc(datasets_->DeleteDataset(&context, request, &response)));
}

StatusOr<UploadAnswer> GrpcClient::UploadStep(const UploadSpec& spec, const GiveVoxels& give) {
  auto answer = CallUploadStep(
      *ingest_, [this](grpc::ClientContext* context) { metadata_.AddTo(context); }, spec, give);
  FOVEA_RETURN_IF_ERROR(Explain(answer.status()));
  return answer;
}

StatusOr<frames::Frame> GrpcClient::RenderFrame(const std::string& dataset, int64_t step,
                                                const frames::FrameSpec& spec) {
  FOVEA_RETURN_IF_ERROR(CheckRequest(step, spec));
  grpc::ClientContext context;
  Prepare(&context);
  v1::RenderFrameRequest request;
  request.set_dataset(dataset);
  request.set_step(static_cast<uint64_t>(step));
  *request.mutable_spec() = wire::ToProto(spec);
  v1::Frame response;
  FOVEA_RETURN_IF_ERROR(
      Explain(wire::FromGrpc(render_->RenderFrame(&context, request, &response))));
  return Receive(std::move(response), 0, false);
}

StatusOr<frames::FramePlan> GrpcClient::PlanFrame(const std::string& dataset, int64_t step,
                                                  const frames::FrameSpec& spec,
                                                  const frames::FrameBudget& budget) {
  FOVEA_RETURN_IF_ERROR(CheckRequest(step, spec));
  grpc::ClientContext context;
  Prepare(&context);
  v1::PlanFrameRequest request;
  request.set_dataset(dataset);
  request.set_step(static_cast<uint64_t>(step));
  *request.mutable_spec() = wire::ToProto(spec);
  if (budget.ms) {
    request.mutable_budget()->set_total_ms(*budget.ms);
  }
  if (budget.memory_bytes) {
    request.mutable_budget()->set_memory_bytes(*budget.memory_bytes);
  }
  if (budget.bytes_read) {
    request.mutable_budget()->set_bytes_read(*budget.bytes_read);
  }
  if (budget.coefficients) {
    request.mutable_budget()->set_coefficients(*budget.coefficients);
  }
  v1::FramePlan response;
  FOVEA_RETURN_IF_ERROR(Explain(wire::FromGrpc(render_->PlanFrame(&context, request, &response))));
  auto plan = wire::FromProto(response);
  FOVEA_RETURN_IF_ERROR(Explain(plan.status()));
  return plan;
}

StatusOr<frames::Frame> GrpcClient::Receive(v1::Frame proto, uint64_t index, bool may_skip) const {
  auto frame = wire::FromProto(std::move(proto));
  FOVEA_RETURN_IF_ERROR(Explain(frame.status()));
  if (may_skip ? frame->index < index : frame->index != index) {
    return Explain(Internal("frame {} came where {} was due", frame->index, index));
  }
  return frame;
}

Status GrpcClient::RenderSequence(const SequenceRequest& request, const OnFrame& on_frame) {
  FOVEA_RETURN_IF_ERROR(CheckRequest(request.first, request.spec));
  if (request.last && *request.last < request.first) {
    return InvalidArgument("last step {} is before the first, {}", *request.last, request.first);
  }
  if (request.last && request.follow) {
    return InvalidArgument("last step {}: a stream that follows has no end", *request.last);
  }
  if (request.stride < 1) {
    return InvalidArgument("stride {} is outside its range, from 1", request.stride);
  }
  v1::RenderSequenceRequest proto = ToProto(request);
  Progress progress;
  progress.next_index = request.start_index;
  while (true) {
    const uint64_t before = progress.next_index;
    if (request.window > 0) {
      proto.set_stream_id(RandomId());  // the stream that was lost may not have noticed yet
    }
    const Status status = Stream(proto, on_frame, &progress);
    const auto retry = wire::RetryDelayOf(status);
    const bool above_quota = absl::IsResourceExhausted(status) && retry && *retry <= kLongestRetry;
    if (progress.stopped || !(absl::IsUnavailable(status) || above_quota) ||
        progress.next_index == before) {
      return progress.stopped ? absl::OkStatus() : status;
    }
    if (above_quota) {
      std::this_thread::sleep_for(*retry);
    }
    // The rest in the same way as what came, also where defaults have changed since.
    if (request.follow) {
      proto.clear_steps();  // what is newest now; indices begin again
      progress.next_index = 0;
    }
    proto.set_start_index(progress.next_index);
    *proto.mutable_spec() = wire::ToProto(progress.used);
    if (request.path) {  // the view of the last frame is not what the path began with
      *proto.mutable_spec()->mutable_view() = wire::ToProto(request.spec).view();
    }
  }
}

Status GrpcClient::Stream(const v1::RenderSequenceRequest& request, const OnFrame& on_frame,
                          Progress* progress) {
  constexpr double kForEver = 1e9;  // the next step comes when it comes
  FrameReader reader(*render_, request, metadata_, request.follow() ? kForEver : deadline_seconds_);
  v1::Frame proto;
  while (reader.Next(&proto)) {
    FOVEA_ASSIGN_OR_RETURN(frames::Frame frame,
                           Receive(std::move(proto), progress->next_index, request.follow()));
    proto.Clear();
    if (!on_frame(frame)) {
      progress->stopped = true;
      return absl::OkStatus();
    }
    progress->used = std::move(frame.used);
    if (request.window() > 0) {
      reader.Acknowledge(frame.index);
    }
    progress->next_index = frame.index + 1;
  }
  return Explain(wire::FromGrpc(reader.Finish()));
}

Status GrpcClient::StreamCoefficients(
    const wire::CoefficientsRequest& request,
    const std::function<Status(const wire::CoefficientsMessage&)>& on_message) {
  FOVEA_RETURN_IF_ERROR(frames::ValidateSpec(request.spec));
  StreamReader<v1::CoefficientBlock> reader(
      metadata_, deadline_seconds_, {},
      [&, proto = wire::ToProto(request)](grpc::ClientContext* context, auto* queue) {
        return coefficients_->PrepareAsyncStreamCoefficients(context, proto, queue);
      });
  v1::CoefficientBlock proto;
  while (reader.Next(&proto)) {
    auto message = wire::FromProto(std::move(proto));
    FOVEA_RETURN_IF_ERROR(Explain(message.status()));
    proto.Clear();
    FOVEA_RETURN_IF_ERROR(Explain(on_message(*message)));
  }
  return Explain(wire::FromGrpc(reader.Finish()));
}

Status GrpcClient::WatchDataset(const WatchRequest& request, const OnEvent& on_event,
                                const GoOn& go_on) {
  if (request.first_step < 0) {
    return InvalidArgument("first step {}: steps count from 0", request.first_step);
  }
  v1::WatchDatasetRequest proto;
  proto.set_dataset(request.dataset);
  proto.set_first_step(static_cast<uint64_t>(request.first_step));
  proto.set_wait(request.wait);
  while (true) {
    bool came = false;
    using Reader = StreamReader<v1::DatasetEvent>;
    Reader reader(metadata_, Reader::kNoDeadline, go_on, [&](auto* context, auto* queue) {
      return datasets_->PrepareAsyncWatchDataset(context, proto, queue);
    });
    for (v1::DatasetEvent message; reader.Next(&message);) {
      came = true;
      const auto event = FromProto(message);
      FOVEA_RETURN_IF_ERROR(Explain(event.status()));
      if (!event->present) {
        proto.set_first_step(0);
      } else if (!event->steps.empty()) {
        proto.set_first_step(static_cast<uint64_t>(event->steps.back().step) + 1);
      }
      if (!on_event(*event)) {
        return absl::OkStatus();
      }
    }
    if (reader.stopped()) {
      return absl::OkStatus();
    }
    const Status status = wire::FromGrpc(reader.Finish());
    if (!came || !absl::IsUnavailable(status)) {
      return Explain(status);
    }
  }
}

StatusOr<std::unique_ptr<ReadingSender>> GrpcClient::SendReadings(const ReadingsSpec& spec,
                                                                  OnHeld on_held) {
  auto sender = GrpcReadingSender::Open(
      *ingest_, [metadata = metadata_](grpc::ClientContext* context) { metadata.AddTo(context); },
      spec, deadline_seconds_, std::move(on_held));
  FOVEA_RETURN_IF_ERROR(Explain(sender.status()));
  return sender;
}

}  // namespace

StatusOr<std::unique_ptr<Client>> Client::Connect(const std::string& address,
                                                  const Credentials& credentials,
                                                  double deadline_seconds) {
  FOVEA_ASSIGN_OR_RETURN(Connection connection, OpenConnection(address, credentials));
  return std::make_unique<GrpcClient>(std::move(connection), deadline_seconds);
}

}  // namespace fovea::client
