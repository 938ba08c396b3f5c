#include "service/client/views_client.h"

#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include <grpcpp/support/sync_stream.h>

#include "fovea/v1/render.grpc.pb.h"
#include "service/client/channel.h"
#include "service/client/stream_reader.h"
#include "service/frames/frames.h"
#include "service/wire/convert.h"
#include "service/wire/status.h"

namespace fovea::client {
namespace {

Status Check(int64_t step, const frames::FrameSpec& spec) {
  return step < 0 ? InvalidArgument("step {}: steps count from 0", step)
                  : frames::ValidateSpec(spec);
}

StatusOr<ViewFrame> FromProto(v1::Frame proto) {
  ViewFrame made;
  made.view_id = proto.view_id();
  made.final = proto.final();
  FOVEA_ASSIGN_OR_RETURN(made.frame, wire::FromProto(std::move(proto)));
  return made;
}

v1::ExploreRequest ToProto(const View& view) {
  v1::ExploreRequest proto;
  proto.set_dataset(view.dataset);
  if (view.latest) {
    proto.set_latest(true);
  } else {
    proto.set_step(static_cast<uint64_t>(view.step));
  }
  proto.set_reset_spec(true);
  *proto.mutable_spec() = wire::ToProto(view.spec);
  proto.set_view_id(view.id);
  proto.set_moving(view.moving);
  proto.set_frame_budget_ms(view.frame_budget_ms);
  return proto;
}

class GrpcExploration final : public Exploration {
 public:
  GrpcExploration(v1::Render::Stub& stub, const Connection& connection, OnViewFrame on_frame,
                  uint32_t window)
      : address_(connection.address), on_frame_(std::move(on_frame)), window_(window) {
    connection.metadata.AddTo(&context_);
    stream_ = stub.Explore(&context_);
    reader_ = std::thread([this] { ReadAll(); });
  }
  ~GrpcExploration() override {
    context_.TryCancel();
    reader_.join();
  }

  Status Show(const View& view) override {
    FOVEA_RETURN_IF_ERROR(Check(view.step, view.spec));
    const std::lock_guard lock(stream_mutex_);
    return Send(view) ? absl::OkStatus() : Ended();
  }
  Status Finish() override {
    {
      const std::lock_guard lock(stream_mutex_);
      if (last_ && std::exchange(last_->moving, false)) {
        static_cast<void>(Send(View(*last_)));  // only what is at rest is drawn in full
      }
    }
    {
      // The acknowledgements of its frames come before the end of what is sent.
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return over_ || drawn_ == shown_; });
    }
    {
      const std::lock_guard lock(stream_mutex_);
      if (!std::exchange(writes_done_, true)) {
        stream_->WritesDone();
      }
    }
    return Ended();
  }

 private:
  /// Under stream_mutex_. False if the call is over.
  bool Send(const View& view) {
    v1::ExploreRequest proto = ToProto(view);
    if (window_ > 0) {
      proto.set_window(window_);
    }
    {
      const std::lock_guard lock(mutex_);
      proto.set_view_id(++shown_);
      ids_[shown_] = view.id;
    }
    last_ = view;
    return !writes_done_ && stream_->Write(proto);
  }
  /// Waits for the end of the call, which is near.
  Status Ended() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return over_; });
    return end_;
  }
  /// The frame with the id that its view was given.
  StatusOr<ViewFrame> Take(v1::Frame proto) {
    FOVEA_ASSIGN_OR_RETURN(ViewFrame frame, FromProto(std::move(proto)));
    const std::lock_guard lock(mutex_);
    const auto found = ids_.find(frame.view_id);
    if (found == ids_.end()) {
      return Internal("a frame of a view that was not asked for");
    }
    frame.view_id = found->second;
    ids_.erase(ids_.begin(), found);  // of older views nothing comes any more
    return frame;
  }
  /// `on_frame_` has taken the frame of the view of this number.
  void Took(const ViewFrame& frame, uint64_t number) {
    if (window_ > 0) {
      v1::ExploreRequest shown;
      shown.set_acknowledged(frame.frame.index);
      const std::lock_guard lock(stream_mutex_);
      if (!writes_done_) {
        static_cast<void>(stream_->Write(shown));  // a call that is over is noticed by Read
      }
    }
    if (frame.final) {
      const std::lock_guard lock(mutex_);
      drawn_ = number;
      changed_.notify_all();
    }
  }
  void ReadAll() {
    Status broken;
    bool stopped = false;
    v1::Frame proto;
    while (!stopped && broken.ok() && stream_->Read(&proto)) {
      const uint64_t number = proto.view_id();
      const auto frame = Take(std::move(proto));
      proto.Clear();
      broken = frame.status();
      stopped = frame.ok() && !on_frame_(*frame);
      if (stopped || !broken.ok()) {
        context_.TryCancel();
      } else {
        Took(*frame, number);
      }
    }
    const Status end = wire::FromGrpc(stream_->Finish());
    const std::lock_guard lock(mutex_);
    end_ = stopped ? absl::OkStatus() : Explain(address_, broken.ok() ? end : broken);
    over_ = true;
    changed_.notify_all();
  }

  const std::string address_;
  const OnViewFrame on_frame_;  // of reader_
  const uint32_t window_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::ExploreRequest, v1::Frame>> stream_;
  std::mutex stream_mutex_;  // one write at a time; before mutex_
  // Guarded by stream_mutex_.
  bool writes_done_ = false;
  std::optional<View> last_;
  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_. Views are numbered, from 1, whatever their ids.
  uint64_t shown_ = 0, drawn_ = 0;    // the last one sent, and the last one drawn in full
  std::map<uint64_t, uint64_t> ids_;  // of views of which frames may come
  bool over_ = false;
  Status end_;  // once over_
  std::thread reader_;
};

class GrpcViewsClient final : public ViewsClient {
 public:
  GrpcViewsClient(Connection connection, double deadline_seconds)
      : connection_(std::move(connection)),
        deadline_seconds_(deadline_seconds),
        render_(v1::Render::NewStub(connection_.channel)) {}

  Status Refine(const RefineRequest& request, const OnViewFrame& on_frame) override {
    FOVEA_RETURN_IF_ERROR(Check(request.step, request.spec));
    v1::RefineFrameRequest proto;
    proto.set_dataset(request.dataset);
    proto.set_step(static_cast<uint64_t>(request.step));
    *proto.mutable_spec() = wire::ToProto(request.spec);
    proto.set_first_frame_ms(request.first_frame_ms);
    StreamReader<v1::Frame> reader(connection_.metadata, deadline_seconds_, {},
                                   [&](auto* context, auto* queue) {
                                     return render_->PrepareAsyncRefineFrame(context, proto, queue);
                                   });
    for (v1::Frame message; reader.Next(&message); message.Clear()) {
      const auto frame = FromProto(std::move(message));
      FOVEA_RETURN_IF_ERROR(Explain(connection_.address, frame.status()));
      if (!on_frame(*frame)) {
        return absl::OkStatus();
      }
    }
    return Explain(connection_.address, wire::FromGrpc(reader.Finish()));
  }
  std::unique_ptr<Exploration> Explore(OnViewFrame on_frame, uint32_t window) override {
    return std::make_unique<GrpcExploration>(*render_, connection_, std::move(on_frame), window);
  }

 private:
  const Connection connection_;
  const double deadline_seconds_;
  const std::unique_ptr<v1::Render::Stub> render_;
};

}  // namespace

StatusOr<std::unique_ptr<ViewsClient>> ViewsClient::Connect(const std::string& address,
                                                            const Credentials& credentials,
                                                            double deadline_seconds) {
  FOVEA_ASSIGN_OR_RETURN(Connection connection, OpenConnection(address, credentials));
  return std::make_unique<GrpcViewsClient>(std::move(connection), deadline_seconds);
}

}  // namespace fovea::client
