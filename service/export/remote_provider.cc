#include <utility>

#include "service/client/client.h"
#include "service/client/local_renderer.h"
#include "service/export/frame_provider.h"
#include "service/frames/foveated_picture.h"

namespace fovea::exports {
namespace {

/// How many of the steps from `begin` on are equally far apart: what one stream can carry.
size_t RunLength(const std::vector<int64_t>& steps, size_t begin) {
  size_t end = begin + 1;
  while (end < steps.size() && steps[end] > steps[end - 1] &&
         (end == begin + 1 || steps[end] - steps[end - 1] == steps[begin + 1] - steps[begin])) {
    ++end;
  }
  return end - begin;
}

/// The cheapest frame that `spec` may become.
frames::FrameSpec Tiny(frames::FrameSpec spec) {
  spec.rate = 1;
  spec.width_px = 1;
  spec.height_px = 1;
  spec.encoding = frames::Encoding::kRawRgba8;
  return spec;
}

class RemoteProvider final : public FrameProvider {
 public:
  RemoteProvider(std::unique_ptr<client::Client> client, client::DatasetSummary summary,
                 std::string identity, Transport transport, int threads)
      : client_(std::move(client)),
        summary_(std::move(summary)),
        identity_(std::move(identity)),
        transport_(transport),
        local_(*client_, summary_.name, threads) {}

  [[nodiscard]] const std::string& identity() const override { return identity_; }
  [[nodiscard]] const store::DatasetInfo& info() const override { return summary_.info; }

  // The service tells time and number of a step with its frame only, so the smallest frames there
  // are get asked for.
  StatusOr<std::vector<StepInfo>> Describe(const std::vector<int64_t>& steps) override {
    const frames::FrameSpec tiny = Tiny({});
    std::vector<StepInfo> described;
    FOVEA_RETURN_IF_ERROR(RenderEach(steps, tiny, [&](const frames::Frame& frame) {
      described.push_back({frame.step, frame.time_ns, frame.frame_number});
      return absl::OkStatus();
    }));
    return described;
  }

  // Only the server can choose the defaults of another field; a frame says what it used. What does
  // not bear on that choice is made cheap, and put back.
  StatusOr<frames::FrameSpec> Resolve(const frames::FrameSpec& spec) override {
    const frames::FrameSpec& defaults = summary_.default_spec;
    frames::FrameSpec tiny = Tiny(spec);
    tiny.strict = false;
    FOVEA_ASSIGN_OR_RETURN(const frames::Frame frame, client_->RenderFrame(summary_.name, 0, tiny));
    frames::FrameSpec resolved = frame.used;
    resolved.rate = spec.rate ? spec.rate : defaults.rate;
    resolved.width_px = spec.width_px ? spec.width_px : defaults.width_px;
    resolved.height_px = spec.height_px ? spec.height_px : defaults.height_px;
    resolved.encoding = spec.encoding;
    resolved.strict = spec.strict;
    return resolved;
  }

  StatusOr<frames::Frame> Render(int64_t step, const frames::FrameSpec& spec) override {
    if (transport_ == Transport::kCoefficients) {
      return RenderHere(step, spec);
    }
    FOVEA_ASSIGN_OR_RETURN(frames::Frame frame,
                           client_->RenderFrame(summary_.name, step, AsSent(spec)));
    return AsWanted(std::move(frame), spec);
  }

  Status RenderEach(const std::vector<int64_t>& steps, const frames::FrameSpec& spec,
                    const std::function<Status(const frames::Frame&)>& on_frame) override {
    return transport_ == Transport::kCoefficients ? RenderEachHere(steps, spec, on_frame)
                                                  : Stream(steps, spec, on_frame);
  }

  Status RenderShot(const Shot& shot, int64_t begin, int64_t end,
                    const std::function<Status(const frames::Frame&)>& on_frame) override {
    const frames::Animation& path = shot.animation;
    if (transport_ == Transport::kCoefficients || path.keys().size() > path.kMaxSentKeys) {
      return FrameProvider::RenderShot(shot, begin, end, on_frame);
    }
    client::SequenceRequest request;
    request.first = shot.first;
    request.last = shot.last;
    request.stride = shot.stride;
    request.path = path;
    request.start_index = static_cast<uint64_t>(begin);
    return StreamFrames(std::move(request), static_cast<size_t>(end - begin), shot.spec, on_frame);
  }

 private:
  [[nodiscard]] Status Stream(const std::vector<int64_t>& steps, const frames::FrameSpec& spec,
                              const std::function<Status(const frames::Frame&)>& on_frame) {
    for (size_t begin = 0; begin < steps.size();) {
      const size_t length = RunLength(steps, begin);
      client::SequenceRequest request;
      request.first = steps[begin];
      request.last = steps[begin + length - 1];
      request.stride = length > 1 ? steps[begin + 1] - steps[begin] : 1;
      FOVEA_RETURN_IF_ERROR(StreamFrames(std::move(request), length, spec, on_frame));
      begin += length;
    }
    return absl::OkStatus();
  }

  /// `count` frames of a request, its dataset and spec to be filled in.
  [[nodiscard]] Status StreamFrames(client::SequenceRequest request, size_t count,
                                    const frames::FrameSpec& spec,
                                    const std::function<Status(const frames::Frame&)>& on_frame) {
    request.dataset = summary_.name;
    request.spec = AsSent(spec);
    // The rest of a path is not wanted; all else ends by itself.
    const bool cut =
        request.path && static_cast<int64_t>(request.start_index + count) < request.path->frames();
    Status stopped;
    size_t received = 0;
    FOVEA_RETURN_IF_ERROR(client_->RenderSequence(request, [&](const frames::Frame& frame) {
      const auto wanted = AsWanted(frame, spec);
      stopped = wanted.ok() ? on_frame(*wanted) : wanted.status();
      ++received;
      return stopped.ok() && !(cut && received == count);
    }));
    FOVEA_RETURN_IF_ERROR(stopped);
    return received == count ? absl::OkStatus()
                             : Unavailable("{}: the stream ended after {} of {} frames", identity_,
                                           received, count);
  }

  [[nodiscard]] StatusOr<frames::Frame> RenderHere(int64_t step, const frames::FrameSpec& spec) {
    FOVEA_RETURN_IF_ERROR(local_.Fetch(step, spec));
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec reached, local_.Reached());
    return local_.Render(reached);
  }

  [[nodiscard]] Status RenderEachHere(const std::vector<int64_t>& steps,
                                      const frames::FrameSpec& spec,
                                      const std::function<Status(const frames::Frame&)>& on_frame) {
    for (size_t i = 0; i < steps.size(); ++i) {
      FOVEA_ASSIGN_OR_RETURN(frames::Frame frame, RenderHere(steps[i], spec));
      frame.index = i;
      FOVEA_RETURN_IF_ERROR(on_frame(frame));
    }
    return absl::OkStatus();
  }

  /// `spec` in the encoding in which frames travel.
  [[nodiscard]] frames::FrameSpec AsSent(frames::FrameSpec spec) const {
    if (transport_ == Transport::kFoveated && spec.encoding != frames::Encoding::kRawRgbaF32) {
      spec.encoding = frames::Encoding::kFoveated;
    }
    return spec;
  }
  /// A frame that came, in the encoding of `spec`.
  [[nodiscard]] static StatusOr<frames::Frame> AsWanted(frames::Frame frame,
                                                        const frames::FrameSpec& spec) {
    if (frame.encoding == spec.encoding) {
      return frame;
    }
    return frames::ExpandFrame(frame, spec.encoding);
  }

  std::unique_ptr<client::Client> client_;
  client::DatasetSummary summary_;
  std::string identity_;
  Transport transport_;
  client::LocalRenderer local_;  // used with kCoefficients
};

}  // namespace

StatusOr<std::unique_ptr<FrameProvider>> OpenRemote(const std::string& address,
                                                    const client::Credentials& credentials,
                                                    const std::string& dataset, Transport transport,
                                                    int threads) {
  FOVEA_ASSIGN_OR_RETURN(auto client, client::Client::Connect(address, credentials));
  FOVEA_ASSIGN_OR_RETURN(client::DatasetSummary summary, client->GetDataset(dataset));
  if (!summary.default_spec.field) {
    return FailedPrecondition("server {}: {} has no committed step yet", address, dataset);
  }
  return std::make_unique<RemoteProvider>(std::move(client), std::move(summary),
                                          fmt::format("{}/{}", address, dataset), transport,
                                          threads);
}

}  // namespace fovea::exports
