#include "service/server/render_service.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "service/frames/frames.h"
#include "service/frames/plan.h"
#include "service/server/admission.h"
#include "service/server/frame_job.h"
#include "service/server/sequence_stream.h"
#include "service/server/stream_reactor.h"
#include "service/server/unary_call.h"
#include "service/server/view_reactors.h"
#include "service/wire/convert.h"
#include "service/wire/printable.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

using FrameCall = UnaryCall<v1::Frame>;

/// A reply and the bytes that gRPC makes of it.
constexpr int64_t kFramesHeld = 2;

/// Pixels that were taken for a frame; given back unless it is rendered: its place in the queue may
/// be refused, or its client may go before its turn comes.
class PixelCharge {
 public:
  PixelCharge(std::shared_ptr<FrameCall> call, int64_t pixels)
      : call_(std::move(call)), pixels_(pixels) {}
  ~PixelCharge() {
    if (!rendered_) {
      call_->caller().GiveBackPixels(pixels_);
    }
  }
  PixelCharge(const PixelCharge&) = delete;
  PixelCharge& operator=(const PixelCharge&) = delete;

  void OnRendered() { rendered_ = true; }

 private:
  const std::shared_ptr<FrameCall> call_;
  const int64_t pixels_;
  bool rendered_ = false;
};

struct Rendering {
  FrameJob job;
  int64_t step = 0;
  std::shared_ptr<PixelCharge> charge;
};

/// Everything up to the rendering itself.
StatusOr<Rendering> Prepare(Services& services, const wire::FrameRequest& request,
                            const std::shared_ptr<FrameCall>& call) {
  Rendering rendering;
  FOVEA_ASSIGN_OR_RETURN(rendering.job,
                         PrepareFrame(*services.catalogue, request.dataset, request.spec));
  FOVEA_ASSIGN_OR_RETURN(
      rendering.step,
      ChooseStep(request.dataset, rendering.job.dataset->dataset(), request.step, request.time_ns));
  FOVEA_ASSIGN_OR_RETURN(auto reservation,
                         services.replies.Reserve(kFramesHeld * rendering.job.reply_bytes));
  call->Hold(std::move(reservation));
  FOVEA_RETURN_IF_ERROR(call->caller().TakePixels(rendering.job.pixels));
  rendering.charge = std::make_shared<PixelCharge>(call, rendering.job.pixels);
  return rendering;
}

void PrepareAndRender(Services& services, const wire::FrameRequest& request,
                      const std::shared_ptr<FrameCall>& call) {
  auto rendering = Prepare(services, request, call);
  if (!rendering.ok()) {
    call->Complete(rendering.status());
    return;
  }
  const int64_t bytes = rendering->job.render_bytes;
  call->Enqueue(services.renders, bytes,
                [call, &services, rendering = *std::move(rendering)](int threads) {
                  rendering.charge->OnRendered();
                  auto frame = RenderJob(rendering.job, rendering.step, 0, threads);
                  services.frames_rendered.fetch_add(1, std::memory_order_relaxed);
                  call->Complete(std::move(frame));
                });
}

/// What this server would not draw it does not count: that takes time and memory with the rate.
Status CheckRate(const store::DatasetInfo& info, const frames::FrameSpec& spec) {
  const auto retained = RetainedSet::Make(info.hierarchy, frames::FoveaOf(spec));
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(retained.status(), "spec"));
  if (retained->SuperVoxelCount() > kMaxSuperVoxelsPerFrame) {
    return ResourceExhausted(
        "rate {} makes {} super-voxels; this server's limit is {} a frame; ask for a smaller rate, "
        "or say a budget",
        FormatRate(*spec.rate), retained->SuperVoxelCount(), kMaxSuperVoxelsPerFrame);
  }
  return absl::OkStatus();
}

StatusOr<v1::FramePlan> Plan(Services& services, const wire::PlanRequest& request) {
  FOVEA_ASSIGN_OR_RETURN(const auto served, services.catalogue->Find(request.frame.dataset));
  store::Dataset& dataset = served->dataset();
  FOVEA_RETURN_IF_ERROR(wire::CheckStep(request.frame.dataset, 0, dataset.info().committed_steps));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, served->DefaultSpec());
  auto resolved = frames::ResolveSpec(dataset, request.frame.spec, defaults);
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(resolved.status(), "spec"));
  FOVEA_ASSIGN_OR_RETURN(const int64_t step, ChooseStep(request.frame.dataset, dataset,
                                                        request.frame.step, request.frame.time_ns));
  const int threads = services.renders.threads();
  frames::FrameBudget budget = request.budget;
  if (budget.IsEmpty()) {
    FOVEA_RETURN_IF_ERROR(CheckRate(dataset.info(), *resolved));
  } else {  // larger rates are not tried
    constexpr auto kMost = static_cast<uint64_t>(kMaxSuperVoxelsPerFrame);
    budget.coefficients = std::min(budget.coefficients.value_or(kMost), kMost);
  }
  FOVEA_ASSIGN_OR_RETURN(const frames::FramePlan plan,
                         budget.IsEmpty()
                             ? frames::PlanFrame(dataset, step, *resolved, threads)
                             : frames::PlanWithin(dataset, step, *resolved, budget, threads));
  return wire::ToProto(request.frame.dataset, step, plan);
}

Status AcknowledgeStream(Services& services, const grpc::CallbackServerContext& context,
                         const v1::AcknowledgeRequest& request) {
  // Its bytes are free: a stream whose acknowledgement was refused would wait for ever.
  FOVEA_ASSIGN_OR_RETURN(const Admission admission,
                         Admit(services, context, {.while_draining = true}));
  const auto stream = services.streams.Find(admission.caller->name(), request.stream_id());
  if (stream == nullptr) {
    return NotFound("stream_id '{}': no such stream runs on this server; it may have ended",
                    wire::Printable(request.stream_id()));
  }
  return stream->Acknowledge(request.index());
}

}  // namespace

grpc::ServerUnaryReactor* RenderService::RenderFrame(grpc::CallbackServerContext* context,
                                                     const v1::RenderFrameRequest* request,
                                                     v1::Frame* response) {
  const auto call = FrameCall::Start(services_, *context,
                                     {.dataset = request->dataset(), .request = request}, response);
  if (call->IsRefusedBy(services_.renders)) {
    return call.get();
  }
  auto parsed = wire::FromProto(*request);
  if (!parsed.ok()) {
    call->Complete(parsed.status());
    return call.get();
  }
  call->Enqueue(services_.lookups, 0,
                [call, &services = services_, request = *std::move(parsed)](int) {
                  PrepareAndRender(services, request, call);
                });
  return call.get();
}

grpc::ServerWriteReactor<v1::Frame>* RenderService::RenderSequence(
    grpc::CallbackServerContext* context, const v1::RenderSequenceRequest* request) {
  using Reactor = StreamReactor<v1::Frame, FrameSink, SequenceStream>;
  return new Reactor(services_, *context, *request, request->window());  // deletes itself
}

grpc::ServerWriteReactor<v1::Frame>* RenderService::RefineFrame(
    grpc::CallbackServerContext* context, const v1::RefineFrameRequest* request) {
  return StartRefineFrame(services_, *context, *request);
}

grpc::ServerBidiReactor<v1::ExploreRequest, v1::Frame>* RenderService::Explore(
    grpc::CallbackServerContext* context) {
  return StartExplore(services_, *context);
}

grpc::ServerUnaryReactor* RenderService::PlanFrame(grpc::CallbackServerContext* context,
                                                   const v1::PlanFrameRequest* request,
                                                   v1::FramePlan* response) {
  return LookUp(
      services_, *context, *request, response,
      [&services = services_](const wire::PlanRequest& asked) { return Plan(services, asked); });
}

/// Also while the server drains: the streams that still run need it. Waits for nothing, so it is
/// answered on gRPC's own thread.
grpc::ServerUnaryReactor* RenderService::Acknowledge(grpc::CallbackServerContext* context,
                                                     const v1::AcknowledgeRequest* request,
                                                     v1::AcknowledgeResponse* /*response*/) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(wire::ToGrpc(AcknowledgeStream(services_, *context, *request)));
  return reactor;
}

}  // namespace fovea::server
